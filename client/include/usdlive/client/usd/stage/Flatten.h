#pragma once

#include <pxr/usd/sdf/layer.h>

namespace usdlive::stage {

class Stage;

/// All that a stage shows as one anonymous layer without arcs to others: metadata, values with the
/// offsets of all arcs applied, paths of files made absolute. The prims of prototypes become prims
/// beside the others, which their instances refer to. Inactive prims are left out, and what schemas
/// alone say is not written.
///
/// Its documentation says which file it was made from, unless `withSource` is false.
[[nodiscard]] pxr::SdfLayerRefPtr flatten(const Stage& stage, bool withSource = true);

}  // namespace usdlive::stage
