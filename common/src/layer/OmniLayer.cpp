// Reads and edits `customLayerData:omni_layer`.
#include "OmniLayer.h"

#include <algorithm>
#include <filesystem>
#include <utility>

#include "usdlive/common/core/LayerPath.h"

namespace usdlive::omniLayer {

const Dictionary* dictionaryAt(const Dictionary& group, const std::string& key) {
    const auto found = group.entries.find(key);
    return found == group.entries.end() ? nullptr : std::get_if<Dictionary>(&found->second);
}

const Value* valueAt(const Dictionary& group, const std::string& key) {
    const auto found = group.entries.find(key);
    return found == group.entries.end() ? nullptr : std::get_if<Value>(&found->second);
}

const Dictionary* groupOf(const LayerDoc& doc) {
    const FieldValue* field = doc.field("/", kField);
    const auto* all = field ? field->as<Dictionary>() : nullptr;
    return all ? dictionaryAt(*all, kGroup) : nullptr;
}

const FieldPart* editedPart(const EditAction& action) {
    const auto* set = std::get_if<SetField>(&action);
    if (set && set->field == kField) return &set->part;
    const auto* erase = std::get_if<EraseField>(&action);
    return erase && erase->field == kField ? &erase->part : nullptr;
}

bool touches(const EditAction& action, std::initializer_list<std::string_view> keys) {
    const FieldPart* part = editedPart(action);
    if (!part) return false;
    const auto* key = std::get_if<DictionaryKey>(part);
    if (!key || key->path.empty()) return true;
    if (key->path[0] != kGroup) return false;
    return key->path.size() == 1 || std::ranges::find(keys, key->path[1]) != keys.end();
}

bool isOnlyIn(const EditAction& action, std::initializer_list<std::string_view> keys) {
    const FieldPart* part = editedPart(action);
    const auto* key = part ? std::get_if<DictionaryKey>(part) : nullptr;
    return key && key->path.size() > 1 && touches(action, keys);
}

std::optional<LayerId> layerAt(const LayerId& from, const std::string& path) {
    namespace fs = std::filesystem;
    const fs::path joined = fs::path(from.value).parent_path() / path;
    auto layer = parseLayerId(joined.lexically_normal().generic_string());
    return layer ? std::optional(std::move(*layer)) : std::nullopt;
}

EditAction keyEdit(std::vector<std::string> keys, std::optional<Value> value) {
    keys.insert(keys.begin(), kGroup);
    FieldPart part = DictionaryKey{std::move(keys)};
    if (value) return SetField{kField, std::move(part), std::move(*value)};
    return EraseField{kField, std::move(part)};
}

}  // namespace usdlive::omniLayer
