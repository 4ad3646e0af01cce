// Finds the layers that a layer uses.
#pragma once

#include <pxr/usd/sdf/layer.h>

#include <set>
#include <string>

#include "usdlive/client/usd/LoadSet.h"

namespace usdlive::client {

/// Returns the asset paths of the layers that a layer uses, as authored: sublayers, references and,
/// with `All`, payloads, also in variants that are not selected. Reads every spec.
[[nodiscard]] std::set<std::string> usedAssets(const pxr::SdfLayerHandle& layer, LoadSet load);

}  // namespace usdlive::client
