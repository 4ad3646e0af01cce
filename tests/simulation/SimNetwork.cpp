#include "SimNetwork.h"

namespace usdlive::simulation {

using server::SessionId;

std::int64_t SimNetwork::delayUs() {
    return random_.chance(5) ? random_.between(1'000, 300'000) : random_.between(100, 20'000);
}

SessionId SimNetwork::open(Ends client) {
    links_[++lastLink_].client = std::move(client);
    return lastLink_;
}

void SimNetwork::sendToServer(SessionId id, SharedBytes message) {
    Link& link = links_.at(id);
    if (!link.clientOpen) return;
    link.toServerUs = std::max(link.toServerUs, clock_.nowUs() + delayUs());
    clock_.at(link.toServerUs, [this, id, message] {
        if (links_.at(id).serverOpen) server.received(id, message);
    });
}

void SimNetwork::sendToClient(SessionId id, SharedBytes message) {
    Link& link = links_.at(id);
    if (!link.serverOpen) return;
    if (link.lastToClient && random_.chance(50)) {  // frames of one message
        link.lastToClient->insert(link.lastToClient->end(), message->begin(), message->end());
        return;
    }
    link.toClientUs = std::max(link.toClientUs, clock_.nowUs() + delayUs());
    auto bytes = std::make_shared<Bytes>(*message);
    link.lastToClient = bytes;
    ++link.queuedToClient;
    clock_.at(link.toClientUs, [this, id, bytes] {
        Link& link = links_.at(id);
        if (link.lastToClient == bytes) link.lastToClient.reset();
        --link.queuedToClient;
        if (link.clientOpen) link.client.toClient(bytes);
        if (link.congested && link.queuedToClient < 3 && link.serverOpen) {
            link.congested = false;
            server.drained(id);
        }
    });
}

bool SimNetwork::congested(SessionId id) {
    Link& link = links_.at(id);
    if (link.queuedToClient > 10) link.congested = true;
    return link.congested;
}

void SimNetwork::tellClientClosed(SessionId id, std::int64_t delayUs) {
    clock_.in(delayUs, [this, id] {
        Link& link = links_.at(id);
        if (!link.clientOpen) return;
        link.clientOpen = false;
        link.client.clientClosed();
    });
}

void SimNetwork::tellServerClosed(SessionId id, std::int64_t delayUs) {
    clock_.in(delayUs, [this, id] {
        Link& link = links_.at(id);
        if (!link.serverOpen) return;
        link.serverOpen = false;
        server.closed(id);
    });
}

void SimNetwork::closeByServer(SessionId id) {
    Link& link = links_.at(id);
    tellClientClosed(id, std::max<std::int64_t>(link.toClientUs - clock_.nowUs(), 0) + delayUs());
    tellServerClosed(id, delayUs());
}

void SimNetwork::cut(SessionId id, bool halfOpen) {
    Link& link = links_.at(id);
    if (!link.clientOpen) return;
    link.clientOpen = false;
    clock_.in(0, [this, id] { links_.at(id).client.clientClosed(); });
    if (halfOpen) return tellServerClosed(id, random_.between(50'000, 2'000'000));
    if (!link.serverOpen) return;
    link.serverOpen = false;
    clock_.in(delayUs(), [this, id] { server.closed(id); });
}

void SimNetwork::cutAll() {
    for (auto& [id, link] : links_) {
        if (link.serverOpen && link.clientOpen) tellClientClosed(id, delayUs());
        link.serverOpen = false;
    }
}

}  // namespace usdlive::simulation
