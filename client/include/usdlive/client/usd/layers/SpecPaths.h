#pragma once

#include <pxr/usd/sdf/path.h>

#include <vector>

#include "usdlive/client/usd/layers/LayerTypes.h"
#include "usdlive/client/usd/layers/StageHost.h"

namespace usdlive::layers {

/// What linking or locking a path is about: a prim and its properties, with `hierarchy` also all
/// below it; a property alone. "/" is the whole stage, but never among them itself. Fails for a
/// path at which the stage has no prim or property.
[[nodiscard]] LayerResult<std::vector<pxr::SdfPath>> specsOf(const StageHost& host,
                                                             const pxr::SdfPath& path,
                                                             bool hierarchy);

}  // namespace usdlive::layers
