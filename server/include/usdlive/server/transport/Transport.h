#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <span>

#include "usdlive/common/core/Bytes.h"
#include "usdlive/common/core/Result.h"
#include "usdlive/server/project/Project.h"  // SessionId
#include "usdlive/server/transport/OddSamples.h"

namespace usdlive::server {

/// Who is told what sessions do. Called on the network thread and never from inside a call of a
/// Transport. What it throws closes the session with ErrorCode::Internal.
class SessionHandler {
public:
    virtual ~SessionHandler() = default;
    virtual void opened(SessionId session) = 0;
    /// One message as it came; the bytes are valid during the call.
    virtual void received(SessionId session, ByteView message) = 0;
    /// Once for every opened(): nothing more comes from it and nothing reaches it, whoever ended
    /// it.
    virtual void closed(SessionId session) = 0;
    /// After Transport::congested() was true: it is no longer.
    virtual void drained(SessionId session) = 0;
};

/// Makes the frames of something big one after the other, nullptr after the last. Called in the
/// background, one call at a time, when the connection has room for more.
using FrameSource = std::function<SharedBytes()>;
/// Runs a function on another thread.
using Background = std::function<void(std::function<void()>)>;

/// All since the start, but for `connections` and `queuedBytes`.
struct TransportCounters {
    std::uint64_t accepted = 0, turnedAway = 0, slowReaders = 0;
    std::uint64_t messagesIn = 0, bytesIn = 0;
    std::uint64_t messagesOut = 0, framesOut = 0, bytesOut = 0;  ///< handed to the system
    std::uint64_t connections = 0;
    std::uint64_t queuedBytes = 0;  ///< waiting or on their way, of all sessions
    OddityCounts ignored{};         ///< samples of DDS
};

/// The kinds of transports. A session's id says which kind carries it.
enum class Carrier : std::uint8_t { WebSocket, Dds };
inline constexpr std::size_t kCarriers = 2;

/// The id before the first session of a transport; the next ones are counted up from it.
[[nodiscard]] constexpr SessionId sessionsOf(Carrier carrier) { return SessionId(carrier) << 40; }
[[nodiscard]] constexpr Carrier carrierOf(SessionId session) { return Carrier(session >> 40); }
/// For people and metrics.
[[nodiscard]] constexpr std::string_view nameOf(Carrier carrier) {
    return carrier == Carrier::WebSocket ? "websocket" : "dds";
}

/// Carries the messages of sessions, in order and without gaps, or ends the session. Belongs to the
/// network thread, as does every call.
class Transport {
public:
    virtual ~Transport() = default;

    [[nodiscard]] virtual Carrier carrier() const = 0;

    /// Sends whole frames, in order. The bytes are shared, not copied. Nothing happens for a
    /// session that is closed or closing.
    virtual void send(SessionId session, SharedBytes frames) = 0;
    /// Sends the commit `revision` to all of them, in order with what send() sends each. What can
    /// send once for many overrides it, and is told also when there is nobody.
    virtual void sendCommit(std::span<const SessionId> sessions, SharedBytes frame,
                            Revision revision);
    /// No commit reaches the session between what send() sends it from here on, until
    /// releaseCommits() or a sendCommit() that names it. It begins so. True: until it has taken
    /// this it takes commits that were sent to others.
    virtual bool holdCommits(SessionId) { return false; }
    /// Commits come from here on, from `next` on, and the states that follow them.
    virtual void releaseCommits(SessionId, Revision /*next*/) {}
    /// Tells `news` to all of them, in the order in which it is called. What can tell once for many
    /// overrides both, and is told also when there is nobody.
    virtual void tell(std::span<const SessionId> sessions, const News& news);
    /// Tells a session what is so far; from then on it is one of those whom tell() concerns.
    virtual void tellFirst(SessionId session, const News& all);
    /// Is more than kCongestedBytes waiting for the session? Then drained() follows.
    [[nodiscard]] virtual bool congested(SessionId session) = 0;
    static constexpr std::size_t kCongestedBytes = 1024 * 1024;
    /// The same, if commits queue up for each session.
    [[nodiscard]] virtual bool lags(SessionId session) { return congested(session); }
    /// Sends what the source makes, between that which send() sends: several sources of a session
    /// take turns, and none is asked while more than kBesideBytes wait.
    virtual void sendBeside(SessionId session, FrameSource source) = 0;
    static constexpr std::size_t kBesideBytes = 256 * 1024;
    static constexpr std::size_t kMaxSources = 65'536;  ///< of a session; then it is cut
    /// Sends what is queued, and the error if there is one, then closes. Sources are dropped.
    virtual void close(SessionId session) = 0;
    virtual void close(SessionId session, const Error& why) = 0;
    /// All of them, and what was told is no longer so.
    virtual void closeAll(const Error& why) = 0;
    /// Stops or goes on reading from a session that sends faster than its work is done.
    virtual void setReading(SessionId session, bool reading) = 0;

    /// No more connections, and all sessions closed with the error. `done` when the last has gone,
    /// or when the time is over and they were cut.
    virtual void stop(const Error& why, std::chrono::milliseconds time,
                      std::function<void()> done) = 0;

    /// For metrics.
    [[nodiscard]] virtual const TransportCounters& counters() const = 0;
};

}  // namespace usdlive::server
