// Listens for HTTP, and hands WebSocket sessions to the transports of their projects.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include "project/Subject.h"
#include "transport/HostNames.h"
#include "transport/Log.h"
#include "transport/Seats.h"
#include "transport/WebSocketTransport.h"
#include "usdlive/common/core/Result.h"

namespace boost::asio {
class io_context;
}

namespace usdlive::server {

class ServerTls;

/// Content that is sent in parts, so that a large file does not take its size in memory.
class HttpContent {
public:
    virtual ~HttpContent() = default;
    [[nodiscard]] virtual std::uint64_t size() const = 0;
    /// Fills `part` from `offset` on. Called by `HttpReply::background`, one call at a time; may
    /// block. After an error the connection is closed, so that the client sees that the rest is
    /// missing.
    [[nodiscard]] virtual Result<void> read(std::uint64_t offset, std::span<std::uint8_t> part) = 0;
};

inline constexpr const char* kZstdEtag = "-zstd";

struct HttpReply {
    std::string contentType;
    std::string body;
    unsigned status = 200;
    std::vector<std::pair<std::string, std::string>> headers = {};
    /// Identifies the body or content. If it is set, the connection answers `If-None-Match`.
    std::string etag = {};
    /// Sent in place of `body`. The connection answers requests for ranges of it.
    std::shared_ptr<HttpContent> content = {};
    /// Runs a job on another thread, or drops it. Set if there is content or `compressed`.
    std::function<void(std::function<void()>)> background = {};
    /// Returns the body or content as a zstd frame, or nullptr if that does not pay. Called by
    /// `background` if the client accepts it and asks for no range. Its ETag ends with kZstdEtag.
    std::function<std::shared_ptr<HttpContent>()> compressed = {};
};

/// Receives the reply to one request. May be called from any thread. Only the first call counts,
/// and calls after the end of the connection are ignored.
using HttpAnswer = std::function<void(HttpReply)>;
/// Answers a GET request, immediately or later. An exception gives the status 500.
using HttpPage = std::function<void(HttpAnswer)>;

/// Answers a POST request. Its body is not read.
struct HttpAction {
    HttpPage run;
};
/// The sessions of a project, and who opens one.
struct HttpSessions {
    WebSocketTransport* transport = nullptr;
    std::optional<SignedIn> user = {};  ///< nothing if users do not sign in
    ShowsToken showsToken = {};         ///< set if the first message shows who it is (AC13)
};

/// Something that the router needs to know is being fetched. `wait` calls its argument when it is
/// here, from any thread; the router is then asked once more.
struct HttpAgain {
    std::function<void(std::function<void()>)> wait;
};

/// The target of a path: a page, a project's WebSocket sessions, or a reply that says why there is
/// none.
using HttpRoute = std::variant<HttpPage, HttpAction, HttpSessions, HttpReply, HttpAgain>;
/// The target of a request, as the client sent it: not decoded.
struct HttpTarget {
    std::string_view path;                ///< without the query
    std::string_view query = {};          ///< after the `?`; may be empty
    std::string_view authorization = {};  ///< the header
    std::string_view peer = {};           ///< the address of the client, without its port
    std::string_view subprotocols = {};   ///< the header Sec-WebSocket-Protocol
};
/// Returns the route of a target, which is valid during the call. Called on the server's thread. A
/// returned transport is used before the next call.
using HttpRouter = std::function<HttpRoute(const HttpTarget& target)>;

struct HttpServerOptions {
    std::string host = "127.0.0.1";
    std::uint16_t port = 0;  ///< 0: a free one
    /// The limits of all connections. Sessions are members; HTTP requests are guests.
    Seats::Limits seats;
    /// The time limit for the request line and the headers, which may have 24 KiB.
    std::chrono::milliseconds headerTime{10'000};
    /// The time limit for a page's answer. After it the status is 503.
    std::chrono::milliseconds answerTime{10'000};
    /// The hosts for which requests are answered (HO1).
    HostNames hosts{{"*"}};
    /// The values of the header Origin that may open sessions; "*" allows all. Browsers send the
    /// origin of the page that connects. Other programs send no origin and may connect.
    std::vector<std::string> allowedOrigins;
    /// Encrypts all connections; nullptr: none. Has to outlive the server, whose thread uses it.
    const ServerTls* tls = nullptr;
};

struct HttpCounters {
    std::uint64_t accepted = 0;
    std::uint64_t turnedAway = 0;   ///< gave way to others
    std::uint64_t connections = 0;  ///< open now, including WebSocket sessions
};

/// Listens for HTTP connections, answers GET and HEAD requests, and hands WebSocket sessions to
/// their transport. Call it only on the thread that runs the io_context.
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
