// The simulated network.
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <span>

#include "SimClock.h"
#include "SimDds.h"
#include "SimRandom.h"
#include "project/Project.h"
#include "usdlive/common/core/Bytes.h"

namespace usdlive::simulation {

/// Connections between editors and the server, some of them over DDS. Each connection delivers in
/// order; there is no order between connections. A cut connection loses everything that is on its
/// way.
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

    /// The percentage of sessions over DDS, and of lost samples.
    unsigned ddsPercent = 0, ddsLossPercent = 0;

    server::SessionId open(Ends client);
    void sendToServer(server::SessionId link, SharedBytes message);
    void sendToClient(server::SessionId link, SharedBytes message);
    /// Sends a commit to all `links`; over DDS once for all.
    void sendCommit(std::span<const server::SessionId> links, const SharedBytes& frame,
                    Revision revision);
    bool holdCommits(server::SessionId link);
    void releaseCommits(server::SessionId link, Revision next);
    [[nodiscard]] bool isDds(server::SessionId id) const;
    [[nodiscard]] bool congested(server::SessionId link);
    /// The server closes the connection; everything that it has sent still arrives.
    void closeByServer(server::SessionId link);
    /// The editor closes the connection. `halfOpen`: everything that it has sent still arrives, and
    /// the server notices late.
    void cut(server::SessionId link, bool halfOpen);
    /// Cuts all connections, because the server's process has ended.
    void cutAll();

private:
    struct Link {
        Ends client;
        bool clientOpen = true, serverOpen = true;
        std::int64_t toServerUs = 0, toClientUs = 0;
        std::shared_ptr<Bytes> lastToClient;  // not delivered yet
        int queuedToClient = 0;
        bool congested = false;
        std::shared_ptr<SimDds> dds;
    };
    std::shared_ptr<SimDds> openDds(server::SessionId link);
    std::int64_t delayUs();
    void notifyClientClosed(server::SessionId link, std::int64_t delayUs);
    void notifyServerClosed(server::SessionId link, std::int64_t delayUs);

    SimClock& clock_;
    SimRandom& random_;
    std::map<server::SessionId, Link> links_;
    server::SessionId lastLink_ = 0;
    server::SentCommits sentCommits_;  // belongs to the server's process
};

}  // namespace usdlive::simulation
