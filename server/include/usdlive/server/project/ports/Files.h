// The port to the files in the project's folder.
#pragma once

#include <cstdint>
#include <vector>

#include "usdlive/common/layer/LayerDoc.h"
#include "usdlive/server/project/CommitStore.h"   // SavedState
#include "usdlive/server/project/ports/Outbox.h"  // SessionId

namespace usdlive::server {

/// A layer to be written to its file.
struct SaveJob {
    LayerId layer;
    LayerDoc doc;
    Revision revision = 0;
    SavedState saved = {};  ///< as far as known
    /// Leave the file as it is if it holds neither what was saved nor what was about to be saved.
    bool onlyIfUnchanged = false;
};

namespace ports {

/// The files in the project's folder.
class Files {
public:
    virtual ~Files() = default;

    /// Reads the layer's file; answered by layerLoaded() with an import.
    virtual void importLayer(const LayerId& layer) = 0;
    /// Reads the layer's file; answered by historyRead().
    virtual void readLayer(SessionId session, std::uint64_t request, const LayerId& layer) = 0;
    /// Writes layers to their files, in the order asked; answered by layersSaved().
    virtual void saveLayers(SessionId session, std::uint64_t request,
                            std::vector<SaveJob> jobs) = 0;
    /// CommitStore::setSaved(), in order with the saves; nothing waits for it.
    virtual void setSaved(const LayerId& layer, const SavedState& saved) = 0;
    /// Reads what the layer's file holds, after the saves asked for so far; answered by
    /// fileChecked().
    virtual void checkFile(const LayerId& layer) = 0;
    /// Reads the layer's file and compares it with `present`, as makeReload() does; answered by
    /// layerReloaded().
    virtual void reloadLayer(SessionId session, std::uint64_t request, const LayerId& layer,
                             LayerDoc present) = 0;
    /// Creates the file of an empty layer; answered by layerCreated().
    virtual void createLayerFile(SessionId session, std::uint64_t request,
                                 const LayerId& layer) = 0;
    /// Looks for files that are not served; answered by skippedListed().
    virtual void listSkipped(SessionId session, std::uint64_t request) = 0;
};

}  // namespace ports
}  // namespace usdlive::server
