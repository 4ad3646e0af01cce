#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "usdlive/common/core/Result.h"
#include "usdlive/server/transport/Log.h"
#include "usdlive/server/transport/Transport.h"

namespace boost::asio {
class io_context;
}

namespace usdlive::server {

struct HttpReply {
    std::string contentType;
    std::string body;
};
/// What `GET path` answers, computed on the network thread.
using HttpRoutes = std::map<std::string, std::function<HttpReply()>, std::less<>>;

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

/// Listens for HTTP, serves `routes`, and takes WebSocket sessions at `/live`. Belongs to the
/// network thread, the one that runs the io_context, as does every call.
class WebSocketServer : public Transport {
public:
    /// As it was chosen when the options say 0.
    [[nodiscard]] virtual std::uint16_t port() const = 0;
    [[nodiscard]] virtual bool isLoopback() const = 0;
};

/// Errors: InvalidConfiguration names the address and what the system says of it.
[[nodiscard]] Result<std::unique_ptr<WebSocketServer>> createWebSocketServer(
    boost::asio::io_context& io, WebSocketServerOptions options, SessionHandler& handler,
    HttpRoutes routes, Background background, Log& log);

}  // namespace usdlive::server
