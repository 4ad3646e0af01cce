// Declares functions that find opinions about a prim or property inside variants of the prims above
// it.
#pragma once

#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/path.h>

#include <vector>

#include "usd/namespace/PathValues.h"

namespace usdlive::naming {

struct VariantMove {
    pxr::SdfLayerHandle layer;
    PathMove move;
};

/// Returns the paths of all specs of `layer` for `object` inside variants, selected or not. For
/// </Set/Chair> this may be </Set{look=a}Chair>.
[[nodiscard]] std::vector<pxr::SdfPath> variantSites(const pxr::SdfLayerHandle& layer,
                                                     const pxr::SdfPath& object);
/// Returns `to` inside the innermost variant of `site`. Returns an empty path if `to` is empty or
/// outside of the variant's prim.
[[nodiscard]] pxr::SdfPath withinVariant(const pxr::SdfPath& site, const pxr::SdfPath& to);

}  // namespace usdlive::naming
