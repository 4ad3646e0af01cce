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

/// What is told to all alike, and is worth nothing once something newer was told.
using News = std::variant<LayerStates, Presences>;
/// A frame of it; nullptr: there is nothing to say.
[[nodiscard]] SharedBytes encodeNews(const News& news);

namespace ports {

/// What a project sends to its sessions.
class Outbox {
public:
    virtual ~Outbox() = default;

    /// Sends encoded frames to a session, in order. The queue is bounded: who does not read is cut
    /// with SlowReader and reported by Project::disconnected().
    virtual void send(SessionId session, SharedBytes frames) = 0;
    /// Sends the commit `revision` to all of `sessions`, which are live and ascending, in order
    /// with the rest that each is sent. A transport that can sends it once for many.
    virtual void sendCommit(std::span<const SessionId> sessions, SharedBytes frame,
                            Revision revision) = 0;
    /// A live session gets something else than live commits for a while, which must not stand
    /// between it: until releaseCommits(). True: it may have got later commits than those sent to
    /// it, as the transport sends them to all.
    virtual bool holdCommits(SessionId session) = 0;
    /// The session is live: from here on it gets the commits from `next` on, as they are sent.
    virtual void releaseCommits(SessionId session, Revision next) = 0;
    /// Tells `news` to all of `sessions`, ascending, each of which has been told what was so far. A
    /// transport that can tells it once for many, and to more than these.
    virtual void tell(std::span<const SessionId> sessions, const News& news) = 0;
    /// Tells a session what is so far, in order with the rest that it is sent.
    virtual void tellFirst(SessionId session, const News& all) = 0;

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
