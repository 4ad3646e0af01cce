#pragma once

#include <set>
#include <vector>

#include "usdlive/common/layer/LayerDoc.h"

namespace usdlive {

// Which layers are muted for everybody on the stages of a root layer: as Kit keeps it, in the root
// layer's `customLayerData:omni_layer:muteness`, {path relative to the root layer: bool}. It is
// content like any other (MU1).

/// Those that are layers of the project; what leads out of it is passed over.
[[nodiscard]] std::set<LayerId> globallyMuted(const LayerId& root, const LayerDoc& doc);

/// What mutes a layer or ends that: edits of the root layer's pseudo-root. A key that means the
/// layer already is used again, however it is written.
[[nodiscard]] std::vector<EditAction> globalMuteEdits(const LayerId& root, const LayerDoc& doc,
                                                      const LayerId& layer, bool muted);

}  // namespace usdlive
