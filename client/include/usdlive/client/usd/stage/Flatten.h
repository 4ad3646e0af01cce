// Declares flatten(), which writes a composed stage as one layer.
#pragma once

#include <pxr/usd/sdf/layer.h>

namespace usdlive::stage {

class Stage;

/// Returns a new anonymous layer that shows the same as the stage, without arcs to other layers.
///
/// It contains the authored metadata and values with all layer offsets applied, and absolute file
/// paths. Each prototype becomes a prim beside the others, and its instances refer to that prim.
/// Inactive prims and values that only schemas define are left out.
///
/// The layer's documentation names the root layer of the stage, unless `withSource` is false. Call
/// it on a thread that may read the stage (see Stage).
[[nodiscard]] pxr::SdfLayerRefPtr flatten(const Stage& stage, bool withSource = true);

}  // namespace usdlive::stage
