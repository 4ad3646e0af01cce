#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "usdlive/common/core/LayerPath.h"
#include "usdlive/common/layer/LayerDoc.h"
#include "usdlive/common/protocol/Control.h"
#include "usdlive/server/project/CommitStore.h"

namespace usdlive::server {

/// A layer as it was in its file.
struct ImportedLayer {
    LayerDoc doc;
    FileStamp file;
};

/// The `.usd`, `.usda` and `.usdc` files of a project's folder. Any thread; one at a time saves a
/// layer.
class LayerFiles {
public:
    virtual ~LayerFiles() = default;

    /// The project's folder, absolute and without links.
    [[nodiscard]] virtual const std::filesystem::path& folder() const = 0;

    /// All layers in the folder and below, over links inside it too (FI5), sorted. Hidden files and
    /// folders, `.usdlive` among them, and names that are no layer's (LN1) are passed over.
    [[nodiscard]] virtual Result<std::vector<LayerFile>> list() const = 0;

    /// What looks like a layer and is passed over all the same, and why (FI5); sorted.
    [[nodiscard]] virtual Result<std::vector<SkippedFile>> skipped() const = 0;

    /// Makes an empty layer's file, and folders for it. LayerExists: there is one of this name.
    [[nodiscard]] virtual Result<void> create(const LayerId& layer) = 0;

    /// Where the layer's file really is or would be. InvalidLayerName: a link leads nowhere, out of
    /// the project or to what is hidden.
    [[nodiscard]] virtual Result<std::filesystem::path> resolve(const LayerId& layer) const = 0;

    /// Reads a file, whatever other parts of the process hold of it. Its big values go to the blob
    /// store. LayerNotFound; LayerUnreadable with OpenUSD's own reason, also for what no layer may
    /// hold (D1), the protocol cannot carry, or is being written at this moment; StorageFull.
    [[nodiscard]] virtual Result<ImportedLayer> import(const LayerId& layer) = 0;

    /// What the file holds now; nothing: there is none.
    [[nodiscard]] virtual Result<std::optional<FileStamp>> stamp(const LayerId& layer) const = 0;

    /// Writes a file, or leaves the one there is as it is: SaveFailed names the file and the
    /// reason. The file is in the format it had; a new `.usd` is in binary. What was written has
    /// been read back and is on the disk. A file of other content than those `expected` is left,
    /// too (LayerOutdated); none expected: any is replaced. `ready` is called with the hash of the
    /// new file right before it takes its place, and may say no.
    using Ready = std::function<Result<void>(const Hash&)>;
    [[nodiscard]] virtual Result<FileStamp> save(const LayerId& layer, const LayerDoc& doc,
                                                 const std::vector<Hash>& expected = {},
                                                 const Ready& ready = {}) = 0;
};

/// Removes what saves that were cut short have left behind. InvalidConfiguration: no such folder.
[[nodiscard]] Result<std::unique_ptr<LayerFiles>> createLayerFiles(
    const std::filesystem::path& folder, BlobStore& blobs);

}  // namespace usdlive::server
