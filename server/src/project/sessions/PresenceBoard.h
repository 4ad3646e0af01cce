// The presences of all sessions (PS1-PS3).
#pragma once

#include <cstdint>
#include <map>

#include "project/Wiring.h"
#include "project/sessions/SessionTable.h"

namespace usdlive::server {

/// Keeps the selection and camera of each session in memory; never stored. Forwards changes in
/// sweeps, so that they cost one frame per session for any number of moving users.
class PresenceBoard : public SessionListener {
public:
    PresenceBoard(SessionTable& sessions, ports::Outbox& outbox)
        : sessions_(sessions), outbox_(outbox) {}

    void show(Session& session, Presence presence);
    /// Forwards changed presences, and drops those that were not sent again for kPresenceTimeMs.
    /// `nowMs` is the time of any steady clock.
    void sweep(std::int64_t nowMs);
    /// Sends a session the presences of all others.
    void sendAllTo(const Session& session);
    [[nodiscard]] bool empty() const { return shown_.empty(); }

    void left(const Session& session) override;

private:
    struct Shown {
        Presence presence;
        bool isFresh = true;       ///< received since the last sweep
        std::int64_t freshMs = 0;  ///< time of the first sweep after it was received last
        bool isPassedOn = false;
    };

    Wire<SessionTable> sessions_;
    Wire<ports::Outbox> outbox_;
    std::map<SessionId, Shown> shown_;
};

}  // namespace usdlive::server
