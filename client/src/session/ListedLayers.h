// The layers of the project and their states, as the server lists them.
#pragma once

#include <map>
#include <set>
#include <vector>

#include "session/Channel.h"
#include "session/SessionEvents.h"

namespace usdlive::client {

/// The layers of the project (SE9), and the states of layers, as the server sent them last.
class ListedLayers {
public:
    ListedLayers(const Channel& channel, SessionEvents& events)
        : channel_(channel), events_(events) {}

    /// There is a new connection: its list comes before the welcome.
    void connected() { next_.clear(); }
    /// Call it before Channel::welcomed(). Returns the layers that the list before did not have.
    std::vector<LayerId> welcomed(const Welcome& message);
    /// Error: MalformedControl (the server lists too many layers).
    Result<void> received(const LayerList& message);
    void received(const ProjectLayers& message);
    void received(const LayerStates& message);

    [[nodiscard]] const std::set<LayerId>& all() const { return layers_; }
    /// Layers that are saved, unlocked and open nowhere have no state.
    [[nodiscard]] const std::map<LayerId, LayerState>& states() const { return states_; }

private:
    std::vector<LayerId> replace(const std::vector<LayerInfo>& listed);

    const Channel& channel_;
    SessionEvents& events_;
    std::set<LayerId> layers_;
    std::set<LayerId> next_;  // those that were listed before the welcome
    std::map<LayerId, LayerState> states_;
};

}  // namespace usdlive::client
