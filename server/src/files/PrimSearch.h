// Looks for prims in the file of a layer.
#pragma once

#include <filesystem>
#include <functional>
#include <string_view>

#include "usdlive/common/core/Id.h"
#include "usdlive/common/core/Result.h"

namespace usdlive::server {

/// Returns whether a file with the content of the layer has a prim spec whose path, without variant
/// selections, satisfies the condition. Error: LayerUnreadable with OpenUSD's reason. Any thread.
[[nodiscard]] Result<bool> hasPrim(const LayerId& layer, const std::filesystem::path& file,
                                   const std::function<bool(std::string_view path)>& condition);

}  // namespace usdlive::server
