// The nodes of a LayerDoc's tree. Used only by its implementation.
#pragma once

#include <array>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "usdlive/common/core/Ref.h"
#include "usdlive/common/layer/ChildSequence.h"
#include "usdlive/common/layer/LayerDoc.h"

namespace usdlive {

using Fields = std::vector<std::pair<std::string, FieldValue>>;  // sorted by name

/// One spec of a LayerDoc. Its parent holds its name.
class LayerDoc::Node : public Shared {
public:
    Node(NodeId id, SpecKind kind) : kind(kind), id(id) {}
    Node(const Node& other);
    Node& operator=(const Node&) = delete;

    [[nodiscard]] const ChildSequence& children(ChildList list) const;
    [[nodiscard]] ChildSequence& editableChildren(ChildList list);
    [[nodiscard]] const FieldValue* field(std::string_view name) const;

    const SpecKind kind;
    const NodeId id;
    Fields fields;

private:
    // Prims or variants (a spec never has both), properties, variant sets.
    using Children = std::array<ChildSequence, 3>;
    std::unique_ptr<Children> children_;  // most specs are attributes and have none
};

/// Return true if specs of the kind can have the list, and if the list can hold the kind.
[[nodiscard]] bool hasList(SpecKind parent, ChildList list);
[[nodiscard]] bool belongsIn(SpecKind child, ChildList list);
inline constexpr std::array kChildLists{ChildList::Prims, ChildList::Properties,
                                        ChildList::VariantSets, ChildList::Variants};

/// Returns the position of the field, or the position for inserting it.
[[nodiscard]] Fields::iterator fieldPosition(Fields& fields, std::string_view name);
[[nodiscard]] Fields::const_iterator fieldPosition(const Fields& fields, std::string_view name);

}  // namespace usdlive
