// Layers that are read without joining them.
#pragma once

#include <functional>
#include <vector>

#include "session/OpenedLayers.h"

namespace usdlive::client {

/// Reads layers as they were at a revision, or as they are now.
class Peeks {
public:
    Peeks(Channel& channel, Requests& requests, SessionEvents& events, const OpenedLayers& opened)
        : channel_(channel), requests_(requests), events_(events), opened_(opened) {}

    using Done = std::function<void(Result<LayerDoc>, Revision)>;
    /// Requests a layer at a revision (0: now).
    void ask(const LayerId& layer, Revision revision, Done done);
    void received(const LayerOpened& message);
    void received(ReceivedSnapshot& snapshot);
    /// Ends the requests whose content is complete.
    void complete();

private:
    struct Peek {
        LayerId layer;
        Revision revision = 0;
        Incoming snapshot;
        Done done;
    };

    Channel& channel_;
    Requests& requests_;
    SessionEvents& events_;
    const OpenedLayers& opened_;
    std::vector<Peek> peeks_;
};

}  // namespace usdlive::client
