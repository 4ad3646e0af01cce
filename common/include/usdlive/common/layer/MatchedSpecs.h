// Compares the contents of a layer that have no common history.
#pragma once

#include "usdlive/common/layer/LayerDoc.h"

namespace usdlive {

/// Returns `content` with the node ids of `present` for the specs that both have, by path and kind.
/// Use it before difference() for contents that do not come from the same commits: equal ids may
/// mean different specs there. Takes long for a large layer.
[[nodiscard]] LayerDoc matchedSpecs(const LayerDoc& present, const LayerDoc& content);

}  // namespace usdlive
