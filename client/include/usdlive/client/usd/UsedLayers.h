#pragma once

#include <pxr/usd/sdf/layer.h>

#include <set>
#include <string>

namespace usdlive::client {

/// As UsdStage::InitialLoadSet: whether layers that only payloads bring in are wanted, too.
enum class LoadSet { All, NoPayloads };

/// The asset paths of the layers that a layer brings in, as it says them: sublayers, references
/// and, with `All`, payloads, also those in variants that are not selected. Looks at every spec.
[[nodiscard]] std::set<std::string> usedAssets(const pxr::SdfLayerHandle& layer, LoadSet load);

}  // namespace usdlive::client
