#pragma once

#include <set>
#include <vector>

#include "usdlive/client/usd/layers/LayerTypes.h"

namespace usdlive::layers {

/// What happened in a frame: one event for each type and layer, where the first of it stood, with
/// all that happened to it.
class EventQueue {
public:
    void push(LayerEvent event);
    void push(LayerEventType type, std::vector<std::string> values = {});
    /// In order; the next frame begins.
    [[nodiscard]] std::vector<LayerEvent> take();

private:
    std::vector<LayerEvent> events_;
};

}  // namespace usdlive::layers
