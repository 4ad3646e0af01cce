// The presences of all sessions (PS1-PS3).
#pragma once

#include <cstdint>
#include <map>

#include "Wiring.h"
#include "sessions/SessionTable.h"

namespace usdlive::server {

/// Keeps the selection and camera that each session shows. Never stored. Changes are passed on in
/// sweeps, so that they cost one frame for each session however many users move.
class PresenceBoard : public SessionListener {
public:
    PresenceBoard(SessionTable& sessions, ports::Outbox& outbox)
        : sessions_(sessions), outbox_(outbox) {}

    void show(Session& session, Presence presence);
    /// Passes on what changed, and drops what was not shown again for kPresenceTimeMs. `nowMs`: any
    /// steady clock.
    void sweep(std::int64_t nowMs);
    /// Sends a session what all others show.
    void sendAllTo(const Session& session);
    [[nodiscard]] bool empty() const { return shown_.empty(); }

    void left(const Session& session) override;

private:
    struct Shown {
        Presence presence;
        bool isFresh = true;       ///< received since the last sweep
        std::int64_t freshMs = 0;  ///< when it was received last, by a sweep
        bool isPassedOn = false;
    };

    Wire<SessionTable> sessions_;
    Wire<ports::Outbox> outbox_;
    std::map<SessionId, Shown> shown_;
};

}  // namespace usdlive::server
