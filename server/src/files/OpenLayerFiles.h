// Opens the layer files of a folder beside others that have it open.
#pragma once

#include <filesystem>
#include <memory>

#include "files/LayerFiles.h"

namespace usdlive::server {

/// Does what createLayerFiles() does, and removes nothing: a save of the others may be under way.
[[nodiscard]] Result<std::unique_ptr<LayerFiles>> openLayerFiles(
    const std::filesystem::path& folder, BlobStore& blobs);

}  // namespace usdlive::server
