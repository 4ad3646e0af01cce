#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "usdlive/common/core/Bytes.h"
#include "usdlive/common/core/Result.h"
#include "usdlive/server/project/Project.h"  // SessionId
#include "usdlive/server/transport/Log.h"

namespace boost::asio {
class io_context;
}

namespace usdlive::server {

/// Who is told what sessions do. Called on the network thread and never from inside a call of
/// WebSocketServer. What it throws closes the session with ErrorCode::Internal.
class SessionHandler {
public:
    virtual ~SessionHandler() = default;
    virtual void opened(SessionId session) = 0;
    /// One message as it came; the bytes are valid during the call.
    virtual void received(SessionId session, ByteView message) = 0;
    /// Once for every opened(): nothing more comes from it and nothing reaches it, whoever ended
    /// it.
    virtual void closed(SessionId session) = 0;
    /// After WebSocketServer::congested() was true: it is no longer.
    virtual void drained(SessionId session) = 0;
};

struct HttpReply {
    std::string contentType;
    std::string body;
};
/// What `GET path` answers, computed on the network thread.
using HttpRoutes = std::map<std::string, std::function<HttpReply()>, std::less<>>;

/// Makes the frames of something big one after the other, nullptr after the last. Called in the
/// background, one call at a time, when the connection has room for more.
using FrameSource = std::function<SharedBytes()>;
/// Runs a function on another thread.
using Background = std::function<void(std::function<void()>)>;

struct WebSocketServerOptions {
    std::string host = "127.0.0.1";
    std::uint16_t port = 0;  ///< 0: a free one
    /// Of one message from a client; larger: FrameTooLarge and close.
    std::size_t maxMessageBytes = 64ull << 20;
    /// HTTP and WebSocket together; who comes when there are as many is hung up on.
    std::size_t maxConnections = 1'256;
    /// What may wait for a reader. One more frame than this and it is cut with SlowReader.
    std::size_t slowReaderBytes = 16ull << 20;
    /// So long may a message take to leave; then the reader is cut, too.
    std::chrono::milliseconds slowReaderTime{10'000};
    /// For the request line and headers of HTTP, which have 8 KiB.
    std::chrono::milliseconds headerTime{10'000};
    /// A peer that has said nothing for half of it is pinged, after all of it is taken for dead.
    std::chrono::milliseconds peerTime{14'000};
    /// Values of the header Origin, by which browsers say whose page connects, that may; "*" is
    /// all. Programs that are no browsers send none and are not asked.
    std::vector<std::string> allowedOrigins;
};

/// All since the start, but for `connections` and `queuedBytes`.
struct TransportCounters {
    std::uint64_t accepted = 0, turnedAway = 0, slowReaders = 0;
    std::uint64_t messagesIn = 0, bytesIn = 0;
    std::uint64_t messagesOut = 0, framesOut = 0, bytesOut = 0;  ///< handed to the system
    std::uint64_t connections = 0;
    std::uint64_t queuedBytes = 0;  ///< waiting or on their way, of all sessions
};

/// Listens for HTTP, serves `routes`, and takes WebSocket sessions at `/live`. Belongs to the
/// network thread, the one that runs the io_context, as does every call.
class WebSocketServer {
public:
    virtual ~WebSocketServer() = default;

    /// As it was chosen when the options say 0.
    [[nodiscard]] virtual std::uint16_t port() const = 0;
    [[nodiscard]] virtual bool isLoopback() const = 0;

    /// Sends whole frames, in order. The bytes are shared, not copied. Nothing happens for a
    /// session that is closed or closing.
    virtual void send(SessionId session, SharedBytes frames) = 0;
    /// Is more than kCongestedBytes waiting for the session? Then drained() follows.
    [[nodiscard]] virtual bool congested(SessionId session) = 0;
    static constexpr std::size_t kCongestedBytes = 1024 * 1024;
    /// Sends what the source makes, between that which send() sends: several sources of a session
    /// take turns, and none is asked while more than kBesideBytes wait.
    virtual void sendBeside(SessionId session, FrameSource source) = 0;
    static constexpr std::size_t kBesideBytes = 256 * 1024;
    static constexpr std::size_t kMaxSources = 65'536;  ///< of a session; then it is cut
    /// Sends what is queued, and the error if there is one, then closes. Sources are dropped.
    virtual void close(SessionId session) = 0;
    virtual void close(SessionId session, const Error& why) = 0;
    virtual void closeAll(const Error& why) = 0;
    /// Stops or goes on reading from a session that sends faster than its work is done.
    virtual void setReading(SessionId session, bool reading) = 0;

    /// No more connections, and all sessions closed with the error. `done` when the last has gone,
    /// or when the time is over and they were cut.
    virtual void stop(const Error& why, std::chrono::milliseconds time,
                      std::function<void()> done) = 0;

    [[nodiscard]] virtual const TransportCounters& counters() const = 0;
};

/// Errors: InvalidConfiguration names the address and what the system says of it.
[[nodiscard]] Result<std::unique_ptr<WebSocketServer>> createWebSocketServer(
    boost::asio::io_context& io, WebSocketServerOptions options, SessionHandler& handler,
    HttpRoutes routes, Background background, Log& log);

}  // namespace usdlive::server
