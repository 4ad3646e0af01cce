#pragma once

#include <initializer_list>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "usdlive/common/layer/LayerDoc.h"

namespace usdlive::omniLayer {

// `customLayerData:omni_layer`, where Kit keeps what is said of layers.
inline const std::string kField = "customLayerData", kGroup = "omni_layer";

/// nullptr: there is none.
[[nodiscard]] const Dictionary* groupOf(const LayerDoc& doc);
/// nullptr: there is no single value of this key.
[[nodiscard]] const Value* valueAt(const Dictionary& group, const std::string& key);
[[nodiscard]] const Dictionary* dictionaryAt(const Dictionary& group, const std::string& key);
/// Which part of a pseudo-root's custom layer data the action sets or erases; nullptr: none.
[[nodiscard]] const FieldPart* editedPart(const EditAction& action);
/// May the action, of a pseudo-root, change what stands at one of these keys of the group?
[[nodiscard]] bool touches(const EditAction& action, std::initializer_list<std::string_view> keys);
/// The layer of the project that a path in `from` leads to, relative to it; nothing: none.
[[nodiscard]] std::optional<LayerId> layerAt(const LayerId& from, const std::string& path);
/// Sets or erases the value at these keys below the group: an edit of the pseudo-root.
[[nodiscard]] EditAction keyEdit(std::vector<std::string> keys, std::optional<Value> value);

}  // namespace usdlive::omniLayer
