// The connections between simulated editors and the server.
#include "SimNetwork.h"

#include "project/CommitContent.h"

namespace usdlive::simulation {

using server::SessionId;

std::int64_t SimNetwork::delayUs() {
    return random_.chance(5) ? random_.between(1'000, 300'000) : random_.between(100, 20'000);
}

SessionId SimNetwork::open(Ends client) {
    Link& link = links_[++lastLink_];
    link.client = std::move(client);
    if (random_.chance(ddsPercent)) link.dds = openDds(lastLink_);
    return lastLink_;
}

std::shared_ptr<SimDds> SimNetwork::openDds(SessionId id) {
    return std::make_shared<SimDds>(clock_, random_, sentCommits_, id, ddsLossPercent,
                                    SimDds::Ends{[this, id](SharedBytes message) {
                                                     if (links_.at(id).clientOpen)
                                                         links_.at(id).client.toClient(message);
                                                 },
                                                 [this, id](SharedBytes message) {
                                                     if (links_.at(id).serverOpen)
                                                         server.received(id, message);
                                                 },
                                                 [this, id] { notifyClientClosed(id, 0); },
                                                 [this, id] {
                                                     if (links_.at(id).serverOpen)
                                                         server.drained(id);
                                                 },
                                                 [this, id] {
                                                     links_.at(id).dds->end();
                                                     notifyClientClosed(id, delayUs());
                                                     notifyServerClosed(id, 0);
                                                 }});
}

void SimNetwork::sendCommit(std::span<const SessionId> links, const SharedBytes& frame,
                            Revision revision) {
    // Some commits are too large to be sent to all at once.
    const bool alone = random_.chance(5) || server::isInParts(*frame);
    for (const SessionId id : links) {
        const auto& dds = links_.at(id).dds;
        if (!dds)
            sendToClient(id, frame);
        else if (alone)
            dds->sendCommit(frame, revision);
        else
            dds->commitSent(revision);
    }
    std::vector<server::SentCommits::Mark> marks;
    for (auto& [id, link] : links_)
        if (link.dds && link.serverOpen && !alone)
            if (const auto mark = link.dds->mark()) marks.push_back(*mark);
    sentCommits_.add(revision,
                     alone ? server::SentCommits::Sent{} : server::SentCommits::Sent{frame, marks});
    if (alone) return;
    const auto* sent = sentCommits_.find(revision);
    for (auto& [id, link] : links_)
        if (link.dds && link.clientOpen) link.dds->broadcast(revision, sent->positionOf(id), frame);
}

bool SimNetwork::holdCommits(SessionId id) {
    const auto& dds = links_.at(id).dds;
    if (dds) dds->holdCommits();
    return dds != nullptr;
}

void SimNetwork::releaseCommits(SessionId id, Revision next) {
    if (const auto& dds = links_.at(id).dds) dds->releaseCommits(next);
}

void SimNetwork::sendToServer(SessionId id, SharedBytes message) {
    Link& link = links_.at(id);
    if (!link.clientOpen) return;
    if (link.dds) return link.dds->sendToServer(std::move(message));
    link.toServerUs = std::max(link.toServerUs, clock_.nowUs() + delayUs());
    clock_.at(link.toServerUs, [this, id, message] {
        if (links_.at(id).serverOpen) server.received(id, message);
    });
}

void SimNetwork::sendToClient(SessionId id, SharedBytes message) {
    Link& link = links_.at(id);
    if (!link.serverOpen) return;
    if (link.dds) return link.dds->send(std::move(message));
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

bool SimNetwork::isDds(SessionId id) const { return links_.at(id).dds != nullptr; }

bool SimNetwork::congested(SessionId id) {
    Link& link = links_.at(id);
    if (link.dds) return link.dds->congested();
    if (link.queuedToClient > 10) link.congested = true;
    return link.congested;
}

void SimNetwork::notifyClientClosed(SessionId id, std::int64_t delayUs) {
    clock_.in(delayUs, [this, id] {
        Link& link = links_.at(id);
        if (!link.clientOpen) return;
        link.clientOpen = false;
        if (link.dds) link.dds->end();
        link.client.clientClosed();
    });
}

void SimNetwork::notifyServerClosed(SessionId id, std::int64_t delayUs) {
    clock_.in(delayUs, [this, id] {
        Link& link = links_.at(id);
        if (!link.serverOpen) return;
        link.serverOpen = false;
        server.closed(id);
    });
}

void SimNetwork::closeByServer(SessionId id) {
    Link& link = links_.at(id);
    if (link.dds) {
        link.dds->close();
        return notifyServerClosed(id, delayUs());
    }
    notifyClientClosed(id, std::max<std::int64_t>(link.toClientUs - clock_.nowUs(), 0) + delayUs());
    notifyServerClosed(id, delayUs());
}

void SimNetwork::cut(SessionId id, bool halfOpen) {
    Link& link = links_.at(id);
    if (!link.clientOpen) return;
    link.clientOpen = false;
    // Over DDS sent data arrives only while the sender can repeat it.
    if (link.dds) link.dds->end();
    clock_.in(0, [this, id] { links_.at(id).client.clientClosed(); });
    if (halfOpen) return notifyServerClosed(id, random_.between(50'000, 2'000'000));
    if (!link.serverOpen) return;
    link.serverOpen = false;
    clock_.in(delayUs(), [this, id] { server.closed(id); });
}

void SimNetwork::cutAll() {
    for (auto& [id, link] : links_) {
        // Over DDS, a client whose session the server has closed may still wait for the
        // notification.
        if (link.clientOpen && (link.serverOpen || link.dds)) notifyClientClosed(id, delayUs());
        link.serverOpen = false;
        if (link.dds) link.dds->end();
    }
    sentCommits_ = {};
}

}  // namespace usdlive::simulation
