// Creates the WebSocket transport of a project.
#pragma once

#include <chrono>
#include <functional>
#include <memory>
#include <string>
#include <string_view>

#include "transport/Log.h"
#include "transport/Transport.h"

namespace boost::asio {
class io_context;
}

namespace usdlive::server {

struct Upgrade;  // src/transport/Upgrade.h

/// Finds out who shows a token in the first message of a session (AC13), and then calls its second
/// argument, on any thread. Error: the session ends with it. May be called from any thread.
using ShowsToken =
    std::function<void(std::string token, std::function<void(Result<SignedIn>)> found)>;
/// The WebSocket subprotocol of such a session.
inline constexpr std::string_view kShowsToken = "usdlive.showToken";

struct WebSocketOptions {
    /// The limit of one message from a client. A larger one gives FrameTooLarge and closes the
    /// session.
    std::size_t maxMessageBytes = 64ull << 20;
    /// The limit of the first message, a hello. It names the layers that a client has open.
    std::size_t maxHelloBytes = 4ull << 20;
    /// The limit of data waiting for a reader. One more frame closes the session with SlowReader.
    std::size_t slowReaderBytes = 16ull << 20;
    /// A reader to which one message takes longer than this is also closed with SlowReader.
    std::chrono::milliseconds slowReaderTime{10'000};
    /// The time limit for the hello, after the upgrade.
    std::chrono::milliseconds greetTime{10'000};
    /// The time limit for the rest of a message, after the last part of it that arrived.
    std::chrono::milliseconds messageTime{30'000};
    /// The time limit for the answer to the upgrade request.
    std::chrono::milliseconds handshakeTime{10'000};
    /// A peer is pinged after half of this time without a message, and treated as lost after all of
    /// it.
    std::chrono::milliseconds peerTime{14'000};
    /// Accepts text, and sends the next messages in the mode of the last one received, as the echo
    /// of the WebSocket conformance suite has to. Otherwise text gives TextFrame and closes the
    /// session.
    bool takesText = false;
};

/// Serves the sessions of one project over WebSockets. HttpServer accepts the connections, on its
/// own thread, and hands them over.
class WebSocketTransport : public Transport {
public:
    /// Opens a session on a connection that requested one. May be called from any thread.
    virtual void take(std::unique_ptr<Upgrade> upgrade) = 0;
};

/// Make every other call on the thread that runs `io`.
[[nodiscard]] std::shared_ptr<WebSocketTransport> createWebSocketTransport(
    boost::asio::io_context& io, WebSocketOptions options, SessionHandler& handler,
    Background background, Log& log);

}  // namespace usdlive::server
