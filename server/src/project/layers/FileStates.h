// The files of layers: which there are, and whether they hold what the server knows of (FI1, FI2).
#pragma once

#include <map>
#include <optional>
#include <vector>

#include "Wiring.h"
#include "layers/LayerTable.h"
#include "layers/SuspectLayers.h"
#include "sessions/SessionTable.h"

namespace usdlive::server {

/// Knows what the layers' files hold. Has a file checked when its size, inode or times have
/// changed.
class FileStates : public LineListener, public LayerListener {
public:
    FileStates(LayerTable& layers, SessionTable& sessions, SuspectLayers& suspects,
               ports::Files& files)
        : layers_(layers), sessions_(sessions), suspects_(suspects), files_(files) {}

    /// The project's folder shows these files. Layers come and go with them (SE9).
    void show(const std::vector<LayerFile>& files);
    /// These layers differed from their files when the server started.
    void setUnsaved(const std::vector<LayerId>& layers);
    /// Lists a layer whose file was created (SE9).
    void addCreated(const LayerId& layer);
    /// The file was just written or read. The folder is looked at again before it may look
    /// otherwise.
    void setSaved(const LayerId& layer, const SavedState& saved);

    [[nodiscard]] bool isDirty(const LayerId& layer) const;
    [[nodiscard]] bool isOutdated(const LayerId& layer) const;
    [[nodiscard]] const SavedState& saved(const LayerId& layer) const;
    /// The file, as the folder showed it last.
    [[nodiscard]] const LayerFile& present(const LayerId& layer) const;

    /// Answer of the port.
    void checked(const LayerId& layer, const Result<std::optional<FileStamp>>& file);

    void ordered(const OrderedCommit& commit) override;
    void rolledBack(const Error& error, const LostCommits& lost) override;
    void loaded(const LayerId& layer, const LoadedLayer& loaded) override;
    void removed(const LayerId& layer) override { entries_.erase(layer); }

private:
    struct Entry {
        SavedState saved;                 ///< as far as known
        bool unsaved = false;             ///< differed from its file when the server started
        LayerFile present;                ///< as the folder showed it last
        std::optional<FileTrace> looked;  ///< how it looked when its content was asked for last
        bool missing = false;             ///< it was there and is not any more
        bool outdated = false;            ///< it holds something else than was written or read last
    };
    [[nodiscard]] const Entry& entry(const LayerId& layer) const;
    void fileWas(const LayerId& layer, const SavedState& saved);
    void checkIfChanged(const LayerId& layer, Entry& entry);
    void announceLayers();

    Wire<LayerTable> layers_;
    Wire<SessionTable> sessions_;
    Wire<SuspectLayers> suspects_;
    Wire<ports::Files> files_;
    std::map<LayerId, Entry> entries_;
};

}  // namespace usdlive::server
