// The port to the files in the project's folder.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "project/CommitStore.h"   // SavedState
#include "project/ports/Outbox.h"  // SessionId
#include "usdlive/common/layer/LayerDoc.h"

namespace usdlive::server {

/// A layer to be written to its file.
struct SaveJob {
    LayerId layer;
    LayerDoc doc;           ///< the layer at `revision`
    Revision revision = 0;  ///< durable
    SavedState saved = {};  ///< the state that the file has, as far as the project knows
    /// If true, the save fails with LayerOutdated if the file was changed outside: if its content
    /// is not that of `saved.file`, of `saved.pending` or of `doc`.
    bool onlyIfUnchanged = false;
};

/// A big value to be written to a file that is no layer.
struct UploadJob {
    std::string path;  ///< a valid name (FI7)
    Hash hash;
    std::uint64_t size = 0;
    bool overwrite = false;
};

namespace ports {

/// Asynchronous access to the files in the project's folder. Each function returns at once. The
/// requests of one session are identified by `request`, which the answer repeats. Functions that
/// write, check or reload files are executed in the order of the calls.
class Files {
public:
    virtual ~Files() = default;

    /// Reads the layer's file for an import. Answered by Project::layerLoaded(), with
    /// LoadedLayer::import set.
    virtual void importLayer(const LayerId& layer) = 0;
    /// Reads the layer's file to show it to one session. Answered by Project::historyRead().
    virtual void readLayer(SessionId session, std::uint64_t request, const LayerId& layer) = 0;
    /// Writes layers to their files and records it with CommitStore::setSaved(). Answered by
    /// Project::layersSaved(), and before it by layersBeingSaved() if it takes long.
    virtual void saveLayers(SessionId session, std::uint64_t request,
                            std::vector<SaveJob> jobs) = 0;
    /// Calls CommitStore::setSaved(), in order with the saves. Not answered.
    virtual void setSaved(const LayerId& layer, const SavedState& saved) = 0;
    /// Reads the metadata and hash of the layer's file, after the saves requested so far. Answered
    /// by Project::fileChecked().
    virtual void checkFile(const LayerId& layer) = 0;
    /// Reads the layer's file and compares it with `present`, the layer's content, by makeReload().
    /// Answered by Project::layerReloaded().
    virtual void reloadLayer(SessionId session, std::uint64_t request, const LayerId& layer,
                             LayerDoc present) = 0;
    /// Creates the file of an empty layer; fails if there is one. Answered by
    /// Project::layerCreated().
    virtual void createLayerFile(SessionId session, std::uint64_t request,
                                 const LayerId& layer) = 0;
    /// Writes a stored big value to a file that is no layer. Answered by Project::fileStored().
    virtual void storeFile(SessionId session, std::uint64_t request, UploadJob job) = 0;
    /// Lists the files in the folder that are not served. Answered by Project::skippedListed().
    virtual void listSkipped(SessionId session, std::uint64_t request) = 0;
};

}  // namespace ports
}  // namespace usdlive::server
