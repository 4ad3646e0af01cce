// The map of locked layers that Kit keeps in a root layer.
#pragma once

#include <vector>

#include "usdlive/common/layer/LayerDoc.h"

namespace usdlive {

/// What empties `customLayerData:omni_layer:locked` where it is a map, {path: bool}: edits of the
/// pseudo-root. The server holds nobody to it; Kit's editors mind it. A layer's own lock stands
/// under the same key and is none (LayerLock.h).
[[nodiscard]] std::vector<EditAction> kitLockMapEdits(const LayerDoc& root);

}  // namespace usdlive
