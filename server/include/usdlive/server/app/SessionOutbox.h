#pragma once

#include <span>
#include <vector>

#include "usdlive/server/project/ports/Outbox.h"
#include "usdlive/server/transport/Transport.h"

namespace usdlive::server {

/// Who carries the messages: number n the sessions of Transport::kSessions * n and on.
class TransportTable {
public:
    void set(std::vector<Transport*> all) { all_ = std::move(all); }
    [[nodiscard]] const std::vector<Transport*>& all() const { return all_; }
    [[nodiscard]] Transport& of(SessionId session) const {
        return *all_.at(session / Transport::kSessions);
    }

private:
    std::vector<Transport*> all_;
};

/// What a project sends goes to the transport of each session. The network thread.
class SessionOutbox final : public ports::Outbox {
public:
    explicit SessionOutbox(const TransportTable& transports) : transports_(transports) {}

    void send(SessionId session, SharedBytes frames) override;
    void sendCommit(std::span<const SessionId> sessions, SharedBytes frame,
                    Revision revision) override;
    bool holdCommits(SessionId session) override;
    void releaseCommits(SessionId session, Revision next) override;
    void tell(std::span<const SessionId> sessions, const News& news) override;
    void tellFirst(SessionId session, const News& all) override;
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
