// States of layers and presences for tests.
#pragma once

#include <string>

#include "usdlive/common/protocol/Control.h"

namespace usdlive::tests {

inline LayerState stateOf(const std::string& layer, Revision saved) {
    LayerState state;
    state.layer = {layer};
    state.saved = saved;
    return state;
}

inline Presence presenceOf(const std::string& client, double time) {
    Presence presence;
    presence.client = {client};
    presence.time = time;
    return presence;
}

}  // namespace usdlive::tests
