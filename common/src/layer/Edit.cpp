// Names the kinds of specs and finds the blobs of an edit.
#include "usdlive/common/layer/Edit.h"

namespace usdlive {

std::string_view specKindName(SpecKind kind) {
    switch (kind) {
        case SpecKind::Attribute:
            return "attribute";
        case SpecKind::Prim:
            return "prim";
        case SpecKind::PseudoRoot:
            return "pseudo-root";
        case SpecKind::Relationship:
            return "relationship";
        case SpecKind::Variant:
            return "variant";
        case SpecKind::VariantSet:
            return "variant set";
    }
    return "unknown kind";
}

void forEachBlob(const EditAction& action, const std::function<void(const Value&)>& visit) {
    const auto* set = std::get_if<SetField>(&action);
    if (!set) return;
    forEachBlob(set->value, visit);
    if (const auto* item = std::get_if<ListItem>(&set->part)) forEachBlob(item->item, visit);
    if (const auto* key = std::get_if<MapKey>(&set->part)) forEachBlob(key->key, visit);
}

}  // namespace usdlive
