// Opens the file of a layer.
#pragma once

#include <pxr/usd/sdf/layer.h>

#include <filesystem>

#include "usdlive/common/core/Id.h"
#include "usdlive/common/core/Result.h"

namespace usdlive::server {

/// Reads a file, independently of layers that the process has open. Error: LayerUnreadable names
/// the layer and OpenUSD's reason; also for a file whose nesting OpenUSD would not survive.
[[nodiscard]] Result<pxr::SdfLayerRefPtr> openLayerFile(const LayerId& layer,
                                                        const std::filesystem::path& path);

[[nodiscard]] inline tl::unexpected<Error> layerUnreadable(const LayerId& layer,
                                                           const std::string& reason) {
    return fail(ErrorCode::LayerUnreadable, layer.value + " cannot be read: " + reason);
}

}  // namespace usdlive::server
