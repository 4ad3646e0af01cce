// The kinds of opinion that access rules distinguish.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string_view>

#include "usdlive/common/layer/Edit.h"

namespace usdlive {

enum class OpinionKind : std::uint8_t {
    Transform,    ///< xformOps and their order
    Geometry,     ///< points, topology, extents, sizes, primvars
    Shading,      ///< inputs and outputs, bindings of materials, displayColor and displayOpacity
    Animation,    ///< time samples and splines of any attribute, value clips
    Variants,     ///< variants, their sets and selections
    Composition,  ///< references, payloads, inherits, specializes, sublayers, relocates
    Schema,       ///< types of prims, API schemas
    Metadata,     ///< all other fields of prims, properties and layers
    Namespace,    ///< creating, deleting, renaming, moving and reordering prims
    Property,     ///< values of all other properties
};

inline constexpr std::array<std::string_view, 10> kOpinionKindNames{
    "transform",   "geometry", "shading",  "animation", "variants",
    "composition", "schema",   "metadata", "namespace", "property"};

[[nodiscard]] constexpr std::string_view nameOf(OpinionKind kind) {
    return kOpinionKindNames[std::size_t(kind)];
}
[[nodiscard]] constexpr std::optional<OpinionKind> opinionKindNamed(std::string_view name) {
    for (std::size_t index = 0; index < kOpinionKindNames.size(); ++index)
        if (kOpinionKindNames[index] == name) return OpinionKind(index);
    return std::nullopt;
}

/// AC7: returns the kind of opinion that the edit of the spec at `path` changes. Returns nothing if
/// it states nothing by itself: it creates a spec, makes a new one an `over`, or declares the type
/// of a property. `exists`: the spec was there before the transaction.
[[nodiscard]] std::optional<OpinionKind> opinionKindOf(std::string_view path,
                                                       const EditAction& action, bool exists);

}  // namespace usdlive
