#pragma once

#include <map>
#include <string>
#include <vector>

#include "usdlive/common/layer/LayerDoc.h"

namespace usdlive {

/// Specs of a stage that only their owners may edit, by path without variants, in every layer of
/// the stage's local layer stack. They stand in the root layer's
/// `customLayerData:omni_layer:specs_locking`, {path: owner}; an empty owner is nobody. Content
/// like any other; the server holds everybody to it (LK5).
using SpecLocks = std::map<std::string, UserName>;

[[nodiscard]] SpecLocks specLocksOf(const LayerDoc& root);

/// What locks a spec or ends its lock: an edit of the root layer's pseudo-root.
[[nodiscard]] EditAction specLockEdit(const std::string& path, const UserName& owner);
[[nodiscard]] EditAction specUnlockEdit(const std::string& path);

/// May the action, of a pseudo-root, change what is locked?
[[nodiscard]] bool touchesSpecLocks(const EditAction& action);

/// The layers that a layer names as its sublayers, as far as they are of the project: strongest
/// first.
[[nodiscard]] std::vector<LayerId> subLayersOf(const LayerId& layer, const LayerDoc& doc);

/// "/A{set=one}B.x" is the spec "/A/B.x" of the stage.
[[nodiscard]] std::string withoutVariants(std::string_view path);

}  // namespace usdlive
