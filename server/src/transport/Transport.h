// The interface of a transport and the events of its sessions.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>

#include "project/Project.h"  // SessionId
#include "transport/IgnoredSamples.h"
#include "usdlive/common/core/Bytes.h"
#include "usdlive/common/core/Result.h"

namespace usdlive::server {

/// Receives the events of sessions. Called on the network thread and never from inside a call to a
/// Transport. An exception closes the session with ErrorCode::Internal.
class SessionHandler {
public:
    virtual ~SessionHandler() = default;
    /// `user`: whoever signed in, or nothing if the server does not ask users to.
    virtual void opened(SessionId session, const std::optional<SignedIn>& user) = 0;
    /// Receives one message. The bytes are valid during the call.
    virtual void received(SessionId session, ByteView message) = 0;
    /// Called once for every opened(), whichever side ended the session. Nothing more is received
    /// from it or sent to it.
    virtual void closed(SessionId session) = 0;
    /// Called after Transport::congested() returned true, when it would return false again.
    virtual void drained(SessionId session) = 0;
};

/// Returns the frames of a large answer one after the other, and nullptr after the last. Called in
/// the background, one call at a time, when the connection has room for more. The argument is the
/// size that a frame should have at most, before compression; it is small on a slow line.
using FrameSource = std::function<SharedBytes(std::size_t)>;
/// Runs a function on another thread.
using Background = std::function<void(std::function<void()>)>;

/// Counts since the start, except `connections` and `queuedBytes`.
struct TransportCounters {
    std::uint64_t accepted = 0, turnedAway = 0, slowReaders = 0;
    std::uint64_t messagesIn = 0, bytesIn = 0;
    std::uint64_t messagesOut = 0, framesOut = 0, bytesOut = 0;  ///< handed to the system
    std::uint64_t connections = 0;
    std::uint64_t queuedBytes = 0;  ///< waiting or being sent, of all sessions
    IgnoreCounts ignored{};         ///< ignored samples of DDS
};

/// The kinds of transports. The id of a session tells its transport.
enum class Carrier : std::uint8_t { WebSocket, Dds };
inline constexpr std::size_t kCarriers = 2;

/// Returns the id before the first session of a transport. Later ids count up from it.
[[nodiscard]] constexpr SessionId sessionsOf(Carrier carrier) { return SessionId(carrier) << 40; }
[[nodiscard]] constexpr Carrier carrierOf(SessionId session) { return Carrier(session >> 40); }
/// Returns the name for messages and metrics.
[[nodiscard]] constexpr std::string_view nameOf(Carrier carrier) {
    return carrier == Carrier::WebSocket ? "websocket" : "dds";
}

/// Sends the messages of sessions in order and without gaps, or ends the session. Belongs to the
/// network thread; make every call there.
class Transport {
public:
    virtual ~Transport() = default;

    [[nodiscard]] virtual Carrier carrier() const = 0;

    /// Sends whole frames in order. The bytes are shared, not copied. Does nothing for a session
    /// that is closed or closing.
    virtual void send(SessionId session, SharedBytes frames) = 0;
    /// Sends the commit `revision` to all `sessions`, in order with the frames of send(). A
    /// multicast transport overrides this, and is called even if `sessions` is empty.
    virtual void sendCommit(std::span<const SessionId> sessions, SharedBytes frame,
                            Revision revision);
    /// Stops commits to the session until releaseCommits(), or until a sendCommit() that names it,
    /// so that none arrives between the frames of send(). A new session starts in this state.
    /// Returns true for a multicast transport: the session may still receive commits that were sent
    /// to others before it receives this.
    virtual bool holdCommits(SessionId) { return false; }
    /// Starts commits to the session again, from `next` on, and the states that follow them.
    virtual void releaseCommits(SessionId, Revision /*next*/) {}
    /// Sends `update` to all `sessions`, in the order of the calls. A multicast transport overrides
    /// this and sendInitialState(), and is called even if `sessions` is empty.
    virtual void sendUpdate(std::span<const SessionId> sessions, const StateUpdate& update);
    /// Sends the present state to a session. From then on, sendUpdate() includes it.
    virtual void sendInitialState(SessionId session, const StateUpdate& all);
    /// Returns true if more than kCongestedBytes wait for the session. drained() follows then.
    [[nodiscard]] virtual bool congested(SessionId session) = 0;
    static constexpr std::size_t kCongestedBytes = 1024 * 1024;
    /// The same for transports that queue commits for each session.
    [[nodiscard]] virtual bool lags(SessionId session) { return congested(session); }
    /// Sends the frames of `source` interleaved with those of send(). The sources of a session take
    /// turns. None is called while as much is on the way as the line carries in a moment (TL1).
    virtual void sendBeside(SessionId session, FrameSource source) = 0;
    static constexpr std::size_t kMaxSources = 65'536;  ///< per session; one more closes it
    /// Sends the queued frames and the error, if any, then closes the session. Drops the sources.
    virtual void close(SessionId session) = 0;
    virtual void close(SessionId session, const Error& why) = 0;
    /// Closes all sessions. Published states are no longer valid.
    virtual void closeAll(const Error& why) = 0;
    /// Pauses or resumes reading from a session whose messages arrive faster than they are
    /// processed.
    virtual void setReading(SessionId session, bool reading) = 0;

    /// Returns the address of the session's other end, which its client cannot choose; the same for
    /// all sessions of a transport that knows none.
    [[nodiscard]] virtual std::string addressOf(SessionId) const { return {}; }

    /// Accepts no more connections and closes all sessions with the error. Calls `done` when the
    /// last one has ended, or after `time`, when the rest is cut off.
    virtual void stop(const Error& why, std::chrono::milliseconds time,
                      std::function<void()> done) = 0;

    /// Returns the counts for metrics.
    [[nodiscard]] virtual const TransportCounters& counters() const = 0;
};

}  // namespace usdlive::server
