#pragma once

#include <chrono>
#include <memory>

#include "usdlive/server/transport/Log.h"
#include "usdlive/server/transport/Transport.h"

namespace boost::asio {
class io_context;
}

namespace usdlive::server {

struct Upgrade;  // src/transport/Upgrade.h

struct WebSocketOptions {
    /// Of one message from a client; larger: FrameTooLarge and close.
    std::size_t maxMessageBytes = 64ull << 20;
    /// What may wait for a reader. One more frame than this and it is cut with SlowReader.
    std::size_t slowReaderBytes = 16ull << 20;
    /// A message may take this long to leave; then the reader is cut, too.
    std::chrono::milliseconds slowReaderTime{10'000};
    /// Time for the answer to the upgrade.
    std::chrono::milliseconds handshakeTime{10'000};
    /// A peer is pinged after half of this time without a message, and is lost after all of it.
    std::chrono::milliseconds peerTime{14'000};
};

/// Carries the sessions of one project over WebSockets. HttpServer accepts the connections, on
/// whichever thread, and hands them over.
class WebSocketTransport : public Transport {
public:
    /// Opens a session on a connection that asked for one. Any thread.
    virtual void take(std::unique_ptr<Upgrade> upgrade) = 0;
};

/// `io` belongs to the thread that every other call is made on.
[[nodiscard]] std::shared_ptr<WebSocketTransport> createWebSocketTransport(
    boost::asio::io_context& io, WebSocketOptions options, SessionHandler& handler,
    Background background, Log& log);

}  // namespace usdlive::server
