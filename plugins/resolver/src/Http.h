// Requests over HTTP that end within a time limit.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "BodySink.h"
#include "Outcome.h"

namespace usdlive::resolver {

struct HttpTimes {
    std::chrono::milliseconds connect{5'000};
    std::chrono::milliseconds answer{20'000};  ///< until the headers arrive
    /// Between two parts of the body, each of some KiB: a server that sends a byte from time to
    /// time sends no part.
    std::chrono::milliseconds stall{15'000};
};

struct HttpAnswer {
    unsigned status = 0;
    std::string etag;    ///< without its quotes
    std::string sha256;  ///< header Usdlive-Sha256
    std::string body;    ///< empty if a sink took it
};

struct HttpRequest {
    std::string host;
    std::uint16_t port = 0;
    std::string target;  ///< percent-encoded path and query
    std::vector<std::pair<std::string, std::string>> headers = {};
    BodySink* sink = nullptr;  ///< receives the body of a successful answer
    bool takesZstd = false;    ///< the server may compress the body (AS5), which is inflated here
    /// The largest body that is kept in memory: a list of a million files.
    std::uint64_t mostBytes = std::uint64_t(256) * 1024 * 1024;
};

/// True for `localhost` and addresses of the loopback interface.
[[nodiscard]] bool isLoopback(const std::string& host);

/// Sends a GET request and waits for the whole answer, on this thread. A failure without a status
/// means that there was no complete answer. Any status is an answer, not a failure. Redirections
/// are not followed. Any thread.
[[nodiscard]] Outcome<HttpAnswer> httpGet(const HttpRequest& request, const HttpTimes& times);

/// While it exists, requests of this thread fail soon after `isStopped` returns true.
class StoppableRequests {
public:
    explicit StoppableRequests(std::function<bool()> isStopped);
    ~StoppableRequests();
    StoppableRequests(const StoppableRequests&) = delete;
    StoppableRequests& operator=(const StoppableRequests&) = delete;
};
/// Returns true if the requests of this thread are stopped.
[[nodiscard]] bool areRequestsStopped();

/// Encodes the characters of a path or a query's value that a URL cannot hold.
[[nodiscard]] std::string urlEncoded(const std::string& text);

}  // namespace usdlive::resolver
