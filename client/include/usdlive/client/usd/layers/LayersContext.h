#pragma once

#include <string>
#include <utility>

#include "usdlive/client/usd/layers/EventQueue.h"
#include "usdlive/client/usd/layers/LayerTypes.h"
#include "usdlive/client/usd/layers/LiveLayers.h"
#include "usdlive/client/usd/layers/LocalStack.h"
#include "usdlive/client/usd/layers/StageHost.h"

namespace usdlive::layers {

/// What the parts of one Layers share.
struct LayersContext {
    explicit LayersContext(StageHost& stageHost) : host(stageHost), stack(stageHost) {}

    bool fail(LayerErrorType type, std::string text) {
        error = {type, std::move(text)};
        return false;
    }
    bool succeed() {
        error = {};
        return true;
    }

    StageHost& host;
    LocalStack stack;
    EventQueue events;
    LastError error;
    LiveLayers* live = nullptr;
};

}  // namespace usdlive::layers
