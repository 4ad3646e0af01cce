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

}  // namespace usdlive
