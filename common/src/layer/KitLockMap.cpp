// Makes the edits that empty Kit's map of locked layers.
#include "usdlive/common/layer/KitLockMap.h"

#include "OmniLayer.h"

namespace usdlive {

std::vector<EditAction> kitLockMapEdits(const LayerDoc& root) {
    std::vector<EditAction> edits;
    const std::string key = "locked";
    const Dictionary* group = omniLayer::groupOf(root);
    const Dictionary* map = group ? omniLayer::dictionaryAt(*group, key) : nullptr;
    if (!map) return edits;
    for (const auto& [layer, locked] : map->entries)
        edits.push_back(omniLayer::keyEdit({key, layer}, {}));
    return edits;
}

}  // namespace usdlive
