// Listens for HTTP, and hands WebSocket sessions to the transports of their projects.
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

/// Receives the reply to one request. May be called from any thread. Only the first call counts,
/// and calls after the end of the connection are ignored.
using HttpAnswer = std::function<void(HttpReply)>;
/// Answers a GET request, immediately or later. An exception gives the status 500.
using HttpPage = std::function<void(HttpAnswer)>;

/// The target of a path: a page, a project's WebSocket sessions, or a reply that says why there is
/// none.
using HttpRoute = std::variant<HttpPage, WebSocketTransport*, HttpReply>;
/// Returns the target of a path. The path is as the client sent it: without the query and not
/// decoded. Called on the server's thread. A returned transport is used before the next call.
using HttpRouter = std::function<HttpRoute(std::string_view path)>;

struct HttpServerOptions {
    std::string host = "127.0.0.1";
    std::uint16_t port = 0;  ///< 0: a free one
    /// The limit of HTTP requests and WebSocket sessions together. Further connections are closed.
    std::size_t maxConnections = 1'256;
    /// The time limit for the request line and the headers, which may have 8 KiB.
    std::chrono::milliseconds headerTime{10'000};
    /// The time limit for a page's answer. After it the status is 503.
    std::chrono::milliseconds answerTime{10'000};
    /// The values of the header Origin that may open sessions; "*" allows all. Browsers send the
    /// origin of the page that connects. Other programs send no origin and may connect.
    std::vector<std::string> allowedOrigins;
};

struct HttpCounters {
    std::uint64_t accepted = 0, turnedAway = 0;  ///< since the start
    std::uint64_t connections = 0;               ///< open now, including WebSocket sessions
};

/// Listens for HTTP connections, answers GET requests, and hands WebSocket sessions to their
/// transport. Call it only on the thread that runs the io_context.
class HttpServer {
public:
    virtual ~HttpServer() = default;
    /// Returns the port, also if the options let the system choose it.
    [[nodiscard]] virtual std::uint16_t port() const = 0;
    [[nodiscard]] virtual bool isLoopback() const = 0;
    [[nodiscard]] virtual HttpCounters counters() const = 0;
    /// Accepts no more connections and closes all that are not sessions.
    virtual void stop() = 0;
};

/// Error: InvalidConfiguration names the address and the system's reason.
[[nodiscard]] Result<std::unique_ptr<HttpServer>> createHttpServer(boost::asio::io_context& io,
                                                                   HttpServerOptions options,
                                                                   HttpRouter router, Log& log);

}  // namespace usdlive::server
