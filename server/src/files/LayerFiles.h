// The layer files of a project's folder.
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "project/CommitStore.h"
#include "usdlive/common/core/LayerPath.h"
#include "usdlive/common/layer/LayerDoc.h"
#include "usdlive/common/protocol/Control.h"

namespace usdlive::server {

/// The content of a layer's file.
struct ImportedLayer {
    LayerDoc doc;
    FileStamp file;
};

/// The `.usd`, `.usda` and `.usdc` files of a project's folder. Any thread may call it, but a layer
/// is saved by one thread at a time.
class LayerFiles {
public:
    virtual ~LayerFiles() = default;

    /// Returns the project's folder, absolute and without links.
    [[nodiscard]] virtual const std::filesystem::path& folder() const = 0;

    /// Returns all layers in the folder and below, also over links inside it (FI5), sorted. Skips
    /// hidden files and folders (such as `.usdlive`) and names that no layer can have (LN1).
    [[nodiscard]] virtual Result<std::vector<LayerFile>> list() const = 0;

    /// Returns the skipped files that look like layers, with the reasons (FI5), sorted.
    [[nodiscard]] virtual Result<std::vector<SkippedFile>> skipped() const = 0;

    /// Creates the file of an empty layer and its folders. Error: LayerExists if the name is used.
    [[nodiscard]] virtual Result<void> create(const LayerId& layer) = 0;

    /// Returns the real path of the layer's file, which need not exist. Error: InvalidLayerName if
    /// a link is broken, leads out of the project, or leads to something hidden.
    [[nodiscard]] virtual Result<std::filesystem::path> resolve(const LayerId& layer) const = 0;

    /// Reads a file, independently of layers that the process has open. Stores its big values in
    /// the blob store. Errors: LayerNotFound; StorageFull; LayerUnreadable with OpenUSD's reason.
    /// It is also LayerUnreadable if the file breaks D1, holds content that the protocol does not
    /// support, or is being written.
    [[nodiscard]] virtual Result<ImportedLayer> import(const LayerId& layer) = 0;

    /// Returns the present state of the file, or nothing if it does not exist.
    [[nodiscard]] virtual Result<std::optional<FileStamp>> stamp(const LayerId& layer) const = 0;

    /// Writes a file, or keeps the old one on an error. SaveFailed names the file and the reason.
    /// The file keeps its format; a new `.usd` file is binary. The written file was read back and
    /// is synced to the disk. If `expected` is not empty and the file has other content, returns
    /// LayerOutdated. `ready` is called with the hash of the new file directly before it replaces
    /// the old one, and can prevent that with an error.
    using Ready = std::function<Result<void>(const Hash&)>;
    [[nodiscard]] virtual Result<FileStamp> save(const LayerId& layer, const LayerDoc& doc,
                                                 const std::vector<Hash>& expected = {},
                                                 const Ready& ready = {}) = 0;

    /// Returns the bytes of a file `layer` with this content: text for `.usda`, else binary.
    /// Errors: BlobNotFound, SaveFailed.
    [[nodiscard]] virtual Result<Bytes> render(const LayerId& layer, const LayerDoc& doc) = 0;
};

/// Returns the layers that a server of the folder lists (LayerFiles::list()), in any order. Error:
/// LayerUnreadable if the folder cannot be listed. Any thread.
[[nodiscard]] Result<std::vector<LayerId>> layersIn(const std::filesystem::path& folder);

/// Also removes the temporary files of interrupted saves and uploads. Error: InvalidConfiguration
/// if the folder does not exist.
[[nodiscard]] Result<std::unique_ptr<LayerFiles>> createLayerFiles(
    const std::filesystem::path& folder, BlobStore& blobs);

/// The same folder as a live session sees it (LV2): layers that it has not used yet are read from
/// their files, and no file is written. save() returns SaveFailed, which says how the changes get
/// into files. create() reserves the name of a layer, which import() then gives as an empty one.
[[nodiscard]] Result<std::unique_ptr<LayerFiles>> createLiveSessionFiles(
    const std::filesystem::path& folder, const std::string& liveSession, BlobStore& blobs);

}  // namespace usdlive::server
