// Kit's dictionary in the custom layer data of a layer.
#pragma once

#include <initializer_list>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "usdlive/common/layer/LayerDoc.h"

namespace usdlive::omniLayer {

// `customLayerData:omni_layer`, the dictionary in which Kit keeps locks and muteness.
inline const std::string kField = "customLayerData", kGroup = "omni_layer";

/// Returns nullptr if the layer has none.
[[nodiscard]] const Dictionary* groupOf(const LayerDoc& doc);
/// Return nullptr if the key has no single value, or no dictionary.
[[nodiscard]] const Value* valueAt(const Dictionary& group, const std::string& key);
[[nodiscard]] const Dictionary* dictionaryAt(const Dictionary& group, const std::string& key);
/// Returns the part of a pseudo-root's custom layer data that the action sets or erases, or
/// nullptr.
[[nodiscard]] const FieldPart* editedPart(const EditAction& action);
/// Returns true if the action, of a pseudo-root, may change the value of one of these keys of the
/// group.
[[nodiscard]] bool touches(const EditAction& action, std::initializer_list<std::string_view> keys);
/// Returns true if the action, of a pseudo-root, changes nothing but the values of these keys, or
/// what is in them.
[[nodiscard]] bool isOnlyIn(const EditAction& action, std::initializer_list<std::string_view> keys);
/// Returns the layer of the project for a path relative to `from`, or nothing if it leads out.
[[nodiscard]] std::optional<LayerId> layerAt(const LayerId& from, const std::string& path);
/// Returns the edit of the pseudo-root that sets or erases the value at these keys of the group.
[[nodiscard]] EditAction keyEdit(std::vector<std::string> keys, std::optional<Value> value);

}  // namespace usdlive::omniLayer
