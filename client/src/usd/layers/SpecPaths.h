// Finds the specs at and below a path of a stage.
#pragma once

#include <pxr/usd/sdf/path.h>

#include <vector>

#include "usdlive/client/usd/layers/LayerTypes.h"
#include "usdlive/client/usd/layers/StageHost.h"

namespace usdlive::layers {

/// Returns the specs for linking or locking a path: a prim with its properties, with `hierarchy`
/// also everything below; or a single property. "/" means the whole stage but is not returned
/// itself. Fails if the stage has no prim or property at the path.
[[nodiscard]] LayerResult<std::vector<pxr::SdfPath>> specsOf(const StageHost& host,
                                                             const pxr::SdfPath& path,
                                                             bool hierarchy);

}  // namespace usdlive::layers
