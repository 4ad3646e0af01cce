// The choice of used layers that are opened together with a layer.
#pragma once

namespace usdlive::client {

/// Whether layers that are used by payloads only are included, like UsdStage::InitialLoadSet.
enum class LoadSet { All, NoPayloads };

}  // namespace usdlive::client
