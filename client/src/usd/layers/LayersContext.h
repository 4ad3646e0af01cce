// The state that the parts of Layers share.
#pragma once

#include <optional>

#include "usd/layers/EventQueue.h"
#include "usd/layers/LocalStack.h"
#include "usdlive/client/usd/layers/LiveLayers.h"
#include "usdlive/client/usd/layers/StageHost.h"

namespace usdlive::layers {

/// The state that the parts of one Layers share.
struct LayersContext {
    explicit LayersContext(StageHost& stageHost) : host(stageHost), stack(stageHost) {}

    /// Returns nothing if the layer is not live.
    [[nodiscard]] std::optional<LiveState> liveState(const pxr::SdfLayerHandle& layer) const {
        return live ? live->state(layer) : std::nullopt;
    }

    StageHost& host;
    LocalStack stack;
    EventQueue events;
    LiveLayers* live = nullptr;
};

}  // namespace usdlive::layers
