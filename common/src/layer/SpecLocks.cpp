// Reads and edits the locks of specs in a root layer (LK5).
#include "usdlive/common/layer/SpecLocks.h"

#include <optional>

#include "OmniLayer.h"
#include "usdlive/common/core/ByteStream.h"

namespace usdlive {

namespace {

const std::string kLocks = "specs_locking", kSubLayers = "subLayers";

}  // namespace

SpecLocks specLocksOf(const LayerDoc& root) {
    SpecLocks locks;
    const Dictionary* group = omniLayer::groupOf(root);
    const Dictionary* stored = group ? omniLayer::dictionaryAt(*group, kLocks) : nullptr;
    if (!stored) return locks;
    for (const auto& [path, entry] : stored->entries) {
        const auto* owner = std::get_if<Value>(&entry);
        locks[path].value = owner ? textOf(*owner).value_or("") : std::string_view();
    }
    return locks;
}

EditAction specUnlockEdit(const std::string& path) {
    return omniLayer::keyEdit({kLocks, path}, {});
}

bool touchesSpecLocks(const EditAction& action) { return omniLayer::touches(action, {kLocks}); }

bool isSpecLockEdit(const EditAction& action) { return omniLayer::isOnlyIn(action, {kLocks}); }

std::vector<LayerId> subLayersOf(const LayerId& layer, const LayerDoc& doc) {
    std::vector<LayerId> subLayers;
    const FieldValue* field = doc.field("/", kSubLayers);
    const auto* list = field ? field->as<ListOp>() : nullptr;
    if (!list) return subLayers;
    for (const Value& item : (*list)[ListName::Explicit]) {
        ByteReader in(item.bytes());
        if (auto found = omniLayer::layerAt(layer, std::string(in.text())))
            subLayers.push_back(std::move(*found));
    }
    return subLayers;
}

std::string withoutVariants(std::string_view path) {
    std::string plain;
    while (!path.empty()) {
        const auto open = path.find('{');
        plain += path.substr(0, open);
        if (open == std::string_view::npos) break;
        const auto close = path.find('}', open);
        if (close == std::string_view::npos) break;
        path.remove_prefix(close + 1);
        if (!path.empty() && path.front() != '{' && path.front() != '.') plain += '/';
    }
    return plain;
}

}  // namespace usdlive
