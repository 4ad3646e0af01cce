// The locks of specs.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "usdlive/common/layer/LayerDoc.h"

namespace usdlive {

/// The specs of a stage that only their owners may edit, by path without variants, in every layer
/// of the stage's local layer stack. Kept in the root layer's
/// `customLayerData:omni_layer:specs_locking`, {path: owner}; an empty owner is nobody. They are
/// content like any other, and the server enforces them for everybody (LK5).
using SpecLocks = std::map<std::string, UserName>;

[[nodiscard]] SpecLocks specLocksOf(const LayerDoc& root);

/// Returns the edit of the root layer's pseudo-root that unlocks a spec.
[[nodiscard]] EditAction specUnlockEdit(const std::string& path);

/// Returns true if the action, of a pseudo-root, may change the spec locks.
[[nodiscard]] bool touchesSpecLocks(const EditAction& action);

/// Returns true if the action, of a pseudo-root, changes only spec locks.
[[nodiscard]] bool isSpecLockEdit(const EditAction& action);

/// Returns the sublayers of a layer that belong to the project, strongest first.
[[nodiscard]] std::vector<LayerId> subLayersOf(const LayerId& layer, const LayerDoc& doc);

/// Returns the path on the stage: "/A{set=one}B.x" becomes "/A/B.x".
[[nodiscard]] std::string withoutVariants(std::string_view path);

}  // namespace usdlive
