#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "usdlive/common/core/Result.h"
#include "usdlive/server/transport/Log.h"
#include "usdlive/server/transport/WebSocketTransport.h"

namespace boost::asio {
class io_context;
}

namespace usdlive::server {

struct HttpReply {
    std::string contentType;
    std::string body;
    unsigned status = 200;
};

/// Takes the reply to one request. Any thread; the first call counts, and calls after the
/// connection has ended are ignored.
using HttpAnswer = std::function<void(HttpReply)>;
/// Answers a GET request, at once or later. What it throws becomes the status 500.
using HttpPage = std::function<void(HttpAnswer)>;

/// What is at a path: a page, a project's WebSocket sessions, or the reply that says why nothing
/// is.
using HttpRoute = std::variant<HttpPage, WebSocketTransport*, HttpReply>;
/// Finds what is at a path, which is as the client sent it, without its query and not decoded.
/// Called on the server's thread; a transport is used before the next call.
using HttpRouter = std::function<HttpRoute(std::string_view path)>;

struct HttpServerOptions {
    std::string host = "127.0.0.1";
    std::uint16_t port = 0;  ///< 0: a free one
    /// HTTP requests and WebSocket sessions together. The server hangs up on further connections.
    std::size_t maxConnections = 1'256;
    /// Time for the request line and the headers, which may have 8 KiB.
    std::chrono::milliseconds headerTime{10'000};
    /// Time for an answer that comes later; then the status 503.
    std::chrono::milliseconds answerTime{10'000};
    /// Values of the header Origin that may open sessions; "*" stands for all. Browsers send the
    /// origin of the page that connects. Other programs send none and may connect.
    std::vector<std::string> allowedOrigins;
};

struct HttpCounters {
    std::uint64_t accepted = 0, turnedAway = 0;  ///< since the start
    std::uint64_t connections = 0;               ///< open now, WebSocket sessions among them
};

/// Listens for HTTP, answers GET requests, and hands WebSocket sessions to their transport. Every
/// call belongs to the thread that runs the io_context.
class HttpServer {
public:
    virtual ~HttpServer() = default;
    /// The chosen one when the options say 0.
    [[nodiscard]] virtual std::uint16_t port() const = 0;
    [[nodiscard]] virtual bool isLoopback() const = 0;
    [[nodiscard]] virtual HttpCounters counters() const = 0;
    /// Accepts no more connections and closes those that are not sessions.
    virtual void stop() = 0;
};

/// Errors: InvalidConfiguration names the address and what the system says of it.
[[nodiscard]] Result<std::unique_ptr<HttpServer>> createHttpServer(boost::asio::io_context& io,
                                                                   HttpServerOptions options,
                                                                   HttpRouter router, Log& log);

}  // namespace usdlive::server
