#pragma once

#include <pxr/usd/sdf/layer.h>

#include <set>
#include <string>

#include "usdlive/client/usd/LoadSet.h"

namespace usdlive::client {

/// The asset paths of the layers that a layer brings in, as it says them: sublayers, references
/// and, with `All`, payloads, also those in variants that are not selected. Looks at every spec.
[[nodiscard]] std::set<std::string> usedAssets(const pxr::SdfLayerHandle& layer, LoadSet load);

}  // namespace usdlive::client
