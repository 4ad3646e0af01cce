// Tells the sessions the names of the project's layers (SE9).
#pragma once

#include <vector>

#include "project/Wiring.h"
#include "project/layers/LayerTable.h"
#include "project/sessions/SessionTable.h"

namespace usdlive::server {

/// Sends the names of the layers: all of them in parts before a welcome, then what changes.
class LayerLists {
public:
    LayerLists(const LayerTable& layers, const SessionTable& sessions, ports::Outbox& outbox)
        : layers_(layers), sessions_(sessions), outbox_(outbox) {}

    /// Sends all names to a session that gets its welcome next.
    void sendAllTo(const Session& session);
    /// Sends the changed names to the sessions that had their welcome.
    void changed(const std::vector<LayerId>& added, const std::vector<LayerId>& removed);

private:
    Wire<const LayerTable> layers_;
    Wire<const SessionTable> sessions_;
    Wire<ports::Outbox> outbox_;
    SharedBytes all_;  // the frames with all names; null: they have to be made
};

}  // namespace usdlive::server
