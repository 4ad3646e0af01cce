// The set of layers whose state may have changed.
#pragma once

#include <set>

#include "usdlive/common/core/Id.h"

namespace usdlive::server {

/// The layers whose state may differ from the one that was sent last. Parts add a layer when they
/// change something that its state depends on. StateBoard checks them.
using SuspectLayers = std::set<LayerId>;

}  // namespace usdlive::server
