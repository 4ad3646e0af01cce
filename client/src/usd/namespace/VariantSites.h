// Opinions about a prim or property within variants of the prims above it.
#pragma once

#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/path.h>

#include <vector>

#include "PathValues.h"

namespace usdlive::naming {

struct VariantMove {
    pxr::SdfLayerHandle layer;
    PathMove move;
};

/// The paths of all specs of `layer` that say something of `object` within a variant, selected or
/// not: </Set{look=a}Chair> for </Set/Chair>.
[[nodiscard]] std::vector<pxr::SdfPath> variantSites(const pxr::SdfLayerHandle& layer,
                                                     const pxr::SdfPath& object);
/// `to` within the innermost variant of `site`. Empty: it is outside of it, or `to` is empty.
[[nodiscard]] pxr::SdfPath withinVariant(const pxr::SdfPath& site, const pxr::SdfPath& to);

}  // namespace usdlive::naming
