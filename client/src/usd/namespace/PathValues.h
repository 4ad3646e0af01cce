// Declares functions that find and replace paths in field values: list operations, internal arcs,
// expressions, arrays, dictionaries and time samples.
#pragma once

#include <pxr/base/vt/value.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/path.h>

#include <set>

#include "usd/namespace/MoveSteps.h"

namespace usdlive::naming {

/// Returns the value with its paths moved by moves that happen at once, or an empty value if no
/// path moves. All of them name paths before the moves. The move of the nearest prefix counts.
[[nodiscard]] pxr::VtValue movedValue(const pxr::VtValue& value, const PathMap& moves);
/// Does the same for the value of a field of arcs, of a spec that is at `owner` after the moves.
/// Removes arcs that would lead to a prim above or below `owner`, as Pcp does.
[[nodiscard]] pxr::VtValue movedArcs(const pxr::VtValue& value, const PathMap& moves,
                                     const pxr::SdfPath& owner);
[[nodiscard]] bool isArcField(const pxr::TfToken& field);
/// Adds the paths in the value to `paths`. Returns false if values of this type contain no paths.
bool collectPaths(const pxr::VtValue& value, pxr::SdfPathSet& paths);

/// Calls `visit(field, value)` for each field of a spec whose value can contain paths.
template <class Visit>
void visitPathFields(const pxr::SdfLayerHandle& layer, const pxr::SdfPath& spec,
                     const Visit& visit);
[[nodiscard]] bool canHavePaths(const pxr::SdfLayerHandle& layer, const pxr::SdfPath& spec,
                                const pxr::TfToken& field);

template <class Visit>
void visitPathFields(const pxr::SdfLayerHandle& layer, const pxr::SdfPath& spec,
                     const Visit& visit) {
    for (const auto& field : layer->ListFields(spec))
        if (canHavePaths(layer, spec, field)) visit(field, layer->GetField(spec, field));
}

}  // namespace usdlive::naming
