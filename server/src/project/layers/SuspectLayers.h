// Layers whose state may have changed.
#pragma once

#include <set>

#include "usdlive/common/core/Id.h"

namespace usdlive::server {

/// Layers whose state may be other than the one that sessions were sent. Parts that change
/// something of a layer's state add it here; StateBoard looks at them.
using SuspectLayers = std::set<LayerId>;

}  // namespace usdlive::server
