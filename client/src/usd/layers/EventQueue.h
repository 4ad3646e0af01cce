// Merges the layer events of a frame.
#pragma once

#include <set>
#include <vector>

#include "usdlive/client/usd/layers/LayerTypes.h"

namespace usdlive::layers {

/// The events of a frame: one for each type and layer, at the place of the first one, with the
/// values of all.
class EventQueue {
public:
    void push(LayerEvent event);
    void push(LayerEventType type, std::vector<std::string> values = {});
    /// Returns the events in order and starts the next frame.
    [[nodiscard]] std::vector<LayerEvent> take();

private:
    std::vector<LayerEvent> events_;
};

}  // namespace usdlive::layers
