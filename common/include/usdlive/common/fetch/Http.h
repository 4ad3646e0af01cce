// Requests over HTTP and HTTPS that end within a time limit.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "usdlive/common/fetch/BodySink.h"
#include "usdlive/common/fetch/Fetched.h"
#include "usdlive/common/fetch/Origin.h"

namespace usdlive::fetch {

struct HttpLimits {
    std::chrono::milliseconds connect{5'000};  ///< to one address of the host, with TLS
    std::chrono::milliseconds answer{20'000};  ///< until the headers arrive
    /// Between two parts of the body, each of some KiB: a server that sends a byte from time to
    /// time sends no part.
    std::chrono::milliseconds stall{15'000};
    /// For the whole request, with the connection. Nothing: the other limits are enough.
    std::optional<std::chrono::milliseconds> whole = std::nullopt;
    /// The largest body that is kept in memory: a list of a million files.
    std::uint64_t bodyBytes = std::uint64_t(256) << 20;
};

using HttpHeaders = std::vector<std::pair<std::string, std::string>>;

/// Which certificate a server may have over HTTPS.
enum class Trust {
    Authorities,  ///< one for its host from an authority that the system trusts, or USDLIVE_CA
    Known,        ///< also the one that this user has accepted for this server (see ClientTls)
    FirstUse,     ///< also a self-signed one if nothing is known yet; it is then known
};

struct HttpRequest {
    Origin origin;
    std::string target;  ///< percent-encoded path and query
    HttpHeaders headers = {};
    Trust trust = Trust::Authorities;
    BodySink* sink = nullptr;  ///< receives the body of a successful answer
    bool isPost = false;       ///< sends POST in place of GET
    std::string form = {};     ///< the body of a POST: encoded names and values, see formOf()
    bool takesZstd = false;    ///< the server may compress the body (AS5), which is inflated here
};

struct HttpAnswer {
    unsigned status = 0;
    HttpHeaders headers = {};
    std::string body = {};  ///< empty if a sink took it, and for an error of more than 64 KiB

    /// Returns the value of a header, in whatever case its name is written; empty if there is none.
    [[nodiscard]] std::string_view header(std::string_view name) const;
    /// Returns the ETag without its quotes.
    [[nodiscard]] std::string etag() const;
};

/// A connection that is opened for the first request, and kept for the next one to the same server.
/// Any thread, one at a time.
class HttpClient {
public:
    /// Requests fail soon after `isStopped`, which may be empty, returns true. It is called on the
    /// thread of get().
    explicit HttpClient(HttpLimits limits, std::function<bool()> isStopped = {});
    ~HttpClient();
    HttpClient(const HttpClient&) = delete;
    HttpClient& operator=(const HttpClient&) = delete;

    /// Sends a request and waits for the whole answer. A second one is sent only if the server
    /// has closed a kept connection before it began to answer. Any status is an answer, not a
    /// failure. Redirections are not followed.
    [[nodiscard]] Fetched<HttpAnswer> get(const HttpRequest& request);

private:
    class Line;
    class Exchange;
    const HttpLimits limits_;
    const std::function<bool()> isStopped_;
    std::unique_ptr<Line> line_;
};

/// Does the same on a connection of its own.
[[nodiscard]] Fetched<HttpAnswer> get(const HttpRequest& request, const HttpLimits& limits,
                                      std::function<bool()> isStopped = {});

/// Returns the fields of a form as a body of a request.
[[nodiscard]] std::string formOf(const HttpHeaders& fields);

/// Encodes the characters of a path or a query's value that a URL cannot hold.
[[nodiscard]] std::string urlEncoded(const std::string& text);

}  // namespace usdlive::fetch
