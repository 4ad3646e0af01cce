// Follows the list of the project's layers and their states.
#include "session/ListedLayers.h"

#include <algorithm>
#include <iterator>

#include "usdlive/common/protocol/ServerControl.h"

namespace usdlive::client {

std::vector<LayerId> ListedLayers::welcomed(const Welcome& message) {
    states_.clear();  // the server sends them again
    return replace(message.layers);
}

// SE9: replaces the list by the one that came before the welcome or, from a server without the
// feature, with it. Returns the new ones.
std::vector<LayerId> ListedLayers::replace(const std::vector<LayerInfo>& listed) {
    const std::set<LayerId> before = std::exchange(layers_, std::exchange(next_, {}));
    for (const LayerInfo& info : listed) layers_.insert(info.layer);
    std::vector<LayerId> added;
    std::ranges::set_difference(layers_, before, std::back_inserter(added));
    return added;
}

Result<void> ListedLayers::received(const LayerList& message) {
    const bool online = channel_.isOnline();
    std::set<LayerId>& list = online ? layers_ : next_;
    event::LayersChanged changed;
    for (const LayerId& layer : message.removed)
        if (list.erase(layer) > 0) changed.removed.push_back(layer);
    for (const LayerId& layer : message.added)
        if (list.insert(layer).second) changed.added.push_back(layer);
    if (list.size() > kMaxLayers)
        return fail(ErrorCode::MalformedControl, "the server listed more than " +
                                                     std::to_string(kMaxLayers) +
                                                     " layers, the most that a project has");
    if (online && !(changed.added.empty() && changed.removed.empty()))
        events_.push(std::move(changed));
    return {};
}

void ListedLayers::received(const ProjectLayers& message) {
    if (!channel_.isOnline()) return;
    const std::set<LayerId> before = layers_;
    event::LayersChanged changed{.added = replace(message.layers), .removed = {}};
    std::ranges::set_difference(before, layers_, std::back_inserter(changed.removed));
    events_.push(std::move(changed));
}

void ListedLayers::received(const LayerStates& message) {
    for (const LayerState& state : message.layers) states_[state.layer] = state;
    events_.push(event::LayerStatesChanged{message.layers});
}

}  // namespace usdlive::client
