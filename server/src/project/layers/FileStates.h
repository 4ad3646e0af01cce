// The files of the project's layers, and whether their content is known to the server (FI1, FI2).
#pragma once

#include <map>
#include <optional>
#include <vector>

#include "project/Wiring.h"
#include "project/layers/LayerLists.h"
#include "project/layers/SuspectLayers.h"

namespace usdlive::server {

/// Keeps the state of the layers' files. Requests a check of a file's content if its size, inode or
/// times have changed.
class FileStates : public LineListener, public LayerListener {
public:
    FileStates(LayerTable& layers, LayerLists& lists, SuspectLayers& suspects, ports::Files& files)
        : layers_(layers), lists_(lists), suspects_(suspects), files_(files) {}

    /// Receives the files of the project's folder. Adds and removes layers accordingly (SE9).
    void show(const std::vector<LayerFile>& files);
    /// Marks layers that differed from their files when the server started.
    void setUnsaved(const std::vector<LayerId>& layers);
    /// Adds a layer whose file was created (SE9).
    void addCreated(const LayerId& layer);
    /// Notes that the file was just written or read. Its metadata count as unchanged until the next
    /// scan of the folder.
    void setSaved(const LayerId& layer, const SavedState& saved);

    [[nodiscard]] bool isDirty(const LayerId& layer) const;
    [[nodiscard]] bool isOutdated(const LayerId& layer) const;
    [[nodiscard]] const SavedState& saved(const LayerId& layer) const;
    /// Returns the file as it was found in the last scan of the folder.
    [[nodiscard]] const LayerFile& present(const LayerId& layer) const;

    /// Answer of ports::Files.
    void checked(const LayerId& layer, const Result<std::optional<FileStamp>>& file);

    void ordered(const OrderedCommit& commit) override;
    void rolledBack(const Error& error, const LostCommits& lost) override;
    void loaded(const LayerId& layer, const LoadedLayer& loaded) override;
    void removed(const LayerId& layer) override { entries_.erase(layer); }

private:
    struct Entry {
        SavedState saved;      ///< the last known SavedState
        bool unsaved = false;  ///< the layer differed from its file when the server started
        LayerFile present;     ///< the file in the last scan of the folder
        std::optional<FileTrace> looked;  ///< metadata at the last check of the content
        bool missing = false;             ///< the file existed and was removed
        bool outdated = false;  ///< the content is not the one that was written or read last
    };
    [[nodiscard]] const Entry& entry(const LayerId& layer) const;
    void noteFile(const LayerId& layer, const SavedState& saved);
    void checkIfChanged(const LayerId& layer, Entry& entry);

    Wire<LayerTable> layers_;
    Wire<LayerLists> lists_;
    Wire<SuspectLayers> suspects_;
    Wire<ports::Files> files_;
    std::map<LayerId, Entry> entries_;
};

}  // namespace usdlive::server
