// The layers that are muted for all users.
#pragma once

#include <set>
#include <vector>

#include "usdlive/common/layer/LayerDoc.h"

namespace usdlive {

// Reads and writes the layers that are muted for all users of a root layer's stages. Kit keeps them
// in the root layer's `customLayerData:omni_layer:muteness`, {path relative to the root layer:
// bool}. They are content like any other (MU1).

/// Returns the muted layers of the project. Ignores paths that lead out of it.
[[nodiscard]] std::set<LayerId> globallyMuted(const LayerId& root, const LayerDoc& doc);

/// Returns true if the action, of a pseudo-root, changes only mutes.
[[nodiscard]] bool isMuteEdit(const EditAction& action);

/// Returns the edits of the root layer's pseudo-root that mute or unmute `layer`. Uses an existing
/// key for the layer, in any spelling.
[[nodiscard]] std::vector<EditAction> globalMuteEdits(const LayerId& root, const LayerDoc& doc,
                                                      const LayerId& layer, bool muted);

}  // namespace usdlive
