// Sends the messages of a project by its transports.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "project/ports/Outbox.h"
#include "transport/Transport.h"

namespace usdlive::server {

/// The transports of a project, by kind.
class TransportTable {
public:
    void add(Transport& transport) { all_[std::size_t(transport.carrier())] = &transport; }
    /// Returns the transport of a session. It exists as long as its sessions.
    [[nodiscard]] Transport& of(SessionId session) const {
        return *all_.at(std::size_t(carrierOf(session)));
    }
    template <class Each>
    void forEach(Each each) const {
        for (Transport* transport : all_)
            if (transport) each(*transport);
    }

private:
    std::array<Transport*, kCarriers> all_{};
};

/// Sends a project's messages over the transport of each session. Network thread.
class SessionOutbox final : public ports::Outbox {
public:
    explicit SessionOutbox(const TransportTable& transports) : transports_(transports) {}

    void send(SessionId session, SharedBytes frames) override;
    void sendCommit(std::span<const SessionId> sessions, SharedBytes frame,
                    Revision revision) override;
    [[nodiscard]] bool isMulticast(SessionId session) const override {
        return carrierOf(session) == Carrier::Dds;
    }
    bool holdCommits(SessionId session) override;
    void releaseCommits(SessionId session, Revision next) override;
    void sendUpdate(std::span<const SessionId> sessions, const StateUpdate& update) override;
    void sendInitialState(SessionId session, const StateUpdate& all) override;
    void sendSnapshot(SessionId session, std::uint64_t request, LayerDoc doc) override;
    void sendBeside(SessionId session, std::vector<SharedBytes> frames) override;
    [[nodiscard]] bool congested(SessionId session) override;
    [[nodiscard]] bool lags(SessionId session) override;
    void close(SessionId session) override;
    void closeAll(const Error& why);

private:
    template <class Each>
    void forTransports(std::span<const SessionId> sessions, Each each);

    const TransportTable& transports_;
};

}  // namespace usdlive::server
