// Paths within the values of fields: in list ops, expressions, arrays, dictionaries and samples.
#pragma once

#include <pxr/base/vt/value.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/path.h>

#include <set>
#include <vector>

namespace usdlive::naming {

/// From where to where; to the empty path: deleted.
struct PathMove {
    pxr::SdfPath from, to;
    bool operator==(const PathMove&) const = default;
};
using PathMoves = std::vector<PathMove>;

/// Where `path` leads after all moves; empty: it is deleted.
[[nodiscard]] pxr::SdfPath followed(const PathMoves& moves, pxr::SdfPath path);

/// The value with its paths moved; empty: it has none that move.
[[nodiscard]] pxr::VtValue movedValue(const pxr::VtValue& value, const PathMove& move);
/// Adds the paths within the value. False: a value of its type has none.
bool collectPaths(const pxr::VtValue& value, pxr::SdfPathSet& paths);

/// Calls `visit(field, value)` for the fields of a spec whose values can have paths within them,
/// except arcs, which Pcp keeps.
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
