#pragma once

#include <functional>
#include <map>
#include <memory>

#include "SimClock.h"
#include "SimRandom.h"
#include "usdlive/common/core/Bytes.h"
#include "usdlive/server/project/Project.h"

namespace usdlive::simulation {

/// Connections between editors and the server. Each delivers in order; between them nothing is in
/// order. A cut connection loses what is under way.
class SimNetwork {
public:
    struct Ends {
        std::function<void(SharedBytes)> toClient;
        std::function<void()> clientClosed;
    };
    struct ServerEnd {
        std::function<void(server::SessionId, SharedBytes)> received;
        std::function<void(server::SessionId)> closed;
        std::function<void(server::SessionId)> drained;
    };

    SimNetwork(SimClock& clock, SimRandom& random) : clock_(clock), random_(random) {}
    ServerEnd server;

    server::SessionId open(Ends client);
    void sendToServer(server::SessionId link, SharedBytes message);
    void sendToClient(server::SessionId link, SharedBytes message);
    [[nodiscard]] bool congested(server::SessionId link);
    /// The server closes: what it has sent still arrives.
    void closeByServer(server::SessionId link);
    /// The editor goes away. `halfOpen`: what it has sent still arrives, and the server notices
    /// late.
    void cut(server::SessionId link, bool halfOpen);
    /// The server's process is gone.
    void cutAll();

private:
    struct Link {
        Ends client;
        bool clientOpen = true, serverOpen = true;
        std::int64_t toServerUs = 0, toClientUs = 0;
        std::shared_ptr<Bytes> lastToClient;  // not delivered yet
        int queuedToClient = 0;
        bool congested = false;
    };
    std::int64_t delayUs();
    void tellClientClosed(server::SessionId link, std::int64_t delayUs);
    void tellServerClosed(server::SessionId link, std::int64_t delayUs);

    SimClock& clock_;
    SimRandom& random_;
    std::map<server::SessionId, Link> links_;
    server::SessionId lastLink_ = 0;
};

}  // namespace usdlive::simulation
