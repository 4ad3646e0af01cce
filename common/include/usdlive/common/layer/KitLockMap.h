// Empties the map of locked layers that Kit keeps in a root layer.
#pragma once

#include <vector>

#include "usdlive/common/layer/LayerDoc.h"

namespace usdlive {

/// Returns the edits of the pseudo-root that empty `customLayerData:omni_layer:locked` if it is a
/// map, {path: bool}. The server does not enforce this map, but Kit's editors respect it. A layer's
/// own lock uses the same key and is not a map (LayerLock.h).
[[nodiscard]] std::vector<EditAction> kitLockMapEdits(const LayerDoc& root);

}  // namespace usdlive
