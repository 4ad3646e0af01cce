// The port for the messages that a project sends to its sessions.
#pragma once

#include <cstdint>
#include <span>
#include <variant>
#include <vector>

#include "usdlive/common/core/Bytes.h"
#include "usdlive/common/layer/LayerDoc.h"
#include "usdlive/common/protocol/Control.h"

namespace usdlive::server {

/// Identifies a connection. The number of a closed connection is not used again.
using SessionId = std::uint64_t;

/// A message that is the same for all sessions: the changed layer states, or the changed presences.
/// Each layer or presence in it replaces its earlier state.
using StateUpdate = std::variant<LayerStates, Presences>;
/// Encodes the update as a frame. Returns nullptr if it has no content.
[[nodiscard]] SharedBytes encodeStateUpdate(const StateUpdate& update);

namespace ports {

/// Sends messages to sessions. No function blocks. Calls for a session that is closed are ignored.
///
/// A session is *live* while it receives each commit as it is made. Before that, and whenever it
/// falls behind, it is sent the commits of the past by send().
class Outbox {
public:
    virtual ~Outbox() = default;

    /// Sends encoded frames to a session, in the order of the calls. The queue is bounded: if a
    /// session does not read, it is closed with SlowReader, and Project::disconnected() follows.
    virtual void send(SessionId session, SharedBytes frames) = 0;
    /// Sends the commit `revision` to `sessions`, which are live and in ascending order, in order
    /// with the frames of send(). A multicast transport sends it once for all sessions.
    virtual void sendCommit(std::span<const SessionId> sessions, SharedBytes frame,
                            Revision revision) = 0;
    /// Returns whether a multicast transport carries the session, so that all its sessions receive
    /// the same commits.
    [[nodiscard]] virtual bool isMulticast(SessionId /*session*/) const { return false; }
    /// Stops live commits to a session until releaseCommits(), so that none arrives between the
    /// frames of send(). Returns true if the session may already have received later commits than
    /// those of sendCommit(), because a multicast transport sent them to all sessions.
    virtual bool holdCommits(SessionId session) = 0;
    /// Makes the session live: it receives the commits from `next` on as they are sent.
    virtual void releaseCommits(SessionId session, Revision next) = 0;
    /// Sends the update to `sessions`, in ascending order. Each of them was sent the initial state
    /// and all updates since. A multicast transport sends it once, and to other sessions too.
    virtual void sendUpdate(std::span<const SessionId> sessions, const StateUpdate& update) = 0;
    /// Sends a session the present state `all`, in order with the frames of send(). Later updates
    /// follow by sendUpdate().
    virtual void sendInitialState(SessionId session, const StateUpdate& all) = 0;

    /// Encodes a layer and sends it in chunks, interleaved with the frames of send(). `request` is
    /// the number of the session's request that it answers.
    virtual void sendSnapshot(SessionId session, std::uint64_t request, LayerDoc doc) = 0;
    /// Sends these frames in order, interleaved with those of send().
    virtual void sendBeside(SessionId session, std::vector<SharedBytes> frames) = 0;

    /// Returns whether so many bytes are queued for the session that the project must send it no
    /// more commits of the past. Project::drained() follows when there is room again.
    [[nodiscard]] virtual bool congested(SessionId session) = 0;
    /// Returns whether a live session has so many bytes queued that it must receive no more live
    /// commits. After Project::drained(), it is sent the missing commits as commits of the past.
    [[nodiscard]] virtual bool lags(SessionId session) = 0;
    /// Sends the queued frames, then closes the connection. Project::disconnected() follows.
    virtual void close(SessionId session) = 0;
};

}  // namespace ports
}  // namespace usdlive::server
