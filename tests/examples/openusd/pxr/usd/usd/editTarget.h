// Declares what the examples use of UsdEditTarget; see stage.h.
#pragma once

#include <pxr/usd/sdf/layer.h>

namespace pxr {

class UsdEditTarget {
public:
    const SdfLayerHandle& GetLayer() const&;
};

}  // namespace pxr
