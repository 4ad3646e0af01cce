// The port for what a project sends to sessions.
#pragma once

#include <cstdint>
#include <span>
#include <variant>
#include <vector>

#include "usdlive/common/core/Bytes.h"
#include "usdlive/common/layer/LayerDoc.h"
#include "usdlive/common/protocol/Control.h"

namespace usdlive::server {

/// One connection, as long as it lasts.
using SessionId = std::uint64_t;

/// Messages that are the same for all sessions. An older one is obsolete once a newer one was sent.
using StateUpdate = std::variant<LayerStates, Presences>;
/// Returns a frame of it; nullptr if it is empty.
[[nodiscard]] SharedBytes encodeStateUpdate(const StateUpdate& update);

namespace ports {

/// What a project sends to its sessions.
class Outbox {
public:
    virtual ~Outbox() = default;

    /// Sends encoded frames to a session, in order. The queue is bounded: a session that does not
    /// read is closed with SlowReader and reported by Project::disconnected().
    virtual void send(SessionId session, SharedBytes frames) = 0;
    /// Sends the commit `revision` to all of `sessions`, which are live and ascending, in order
    /// with the rest that each is sent. A multicast transport sends it once for all sessions.
    virtual void sendCommit(std::span<const SessionId> sessions, SharedBytes frame,
                            Revision revision) = 0;
    /// A live session gets something else than live commits until releaseCommits(); no live commit
    /// may come in between. True: it may have got later commits than those sent to it, because the
    /// transport sends them to all.
    virtual bool holdCommits(SessionId session) = 0;
    /// The session is live: from here on it gets the commits from `next` on, as they are sent.
    virtual void releaseCommits(SessionId session, Revision next) = 0;
    /// Sends `update` to all of `sessions`, ascending, each of which has got all that was sent
    /// before. A multicast transport sends it once, and to more sessions than these.
    virtual void sendUpdate(std::span<const SessionId> sessions, const StateUpdate& update) = 0;
    /// Sends a session all that is known so far, in order with the rest that it is sent.
    virtual void sendInitialState(SessionId session, const StateUpdate& all) = 0;

    /// Encodes and sends a snapshot, chunk by chunk, beside the stream.
    virtual void sendSnapshot(SessionId session, std::uint64_t request, LayerDoc doc) = 0;
    /// Sends these frames beside the stream, in order.
    virtual void sendBeside(SessionId session, std::vector<SharedBytes> frames) = 0;

    /// Is so much queued for the session that history should wait? Then no more commits of the past
    /// are sent to it until Project::drained().
    [[nodiscard]] virtual bool congested(SessionId session) = 0;
    /// The same, of a session whose live commits queue up for it: it gets no more of them until
    /// drained(), and then those of the past.
    [[nodiscard]] virtual bool lags(SessionId session) = 0;
    /// Sends what is queued, then closes.
    virtual void close(SessionId session) = 0;
};

}  // namespace ports
}  // namespace usdlive::server
