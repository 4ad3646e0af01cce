// The connection of an HTTP client.
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/system/error_code.hpp>
#include <chrono>
#include <cstddef>
#include <functional>
#include <span>
#include <string>
#include <string_view>

#include "usdlive/common/fetch/Http.h"
#include "usdlive/common/net/NetStream.h"

namespace usdlive::fetch {

/// A connection to a server, encrypted if its URL begins with https. All calls wait, but end soon
/// after `isStopped` returns true. After an error it cannot be used any more.
class HttpClient::Line {
public:
    using Time = std::chrono::steady_clock::time_point;

    /// `isStopped` may be empty; it outlives the line.
    Line(Origin origin, Trust trust, const std::function<bool()>& isStopped)
        : origin_(std::move(origin)), trust_(trust), isStopped_(isStopped), stream_(io_) {}

    [[nodiscard]] bool isFor(const HttpRequest& request) const {
        return origin_ == request.origin && trust_ == request.trust;
    }

    /// Tries all addresses of the host, each for at most `limit`, until `end`.
    [[nodiscard]] Fetched<void> connect(std::chrono::milliseconds limit, Time end);
    /// Reads what has arrived, and waits for it if necessary. Returns the count of bytes. Error:
    /// eof at the end.
    [[nodiscard]] tl::expected<std::size_t, boost::system::error_code> read(std::span<char> space,
                                                                            Time end);
    [[nodiscard]] boost::system::error_code write(std::string_view text, Time end);

private:
    using ErrorCode = boost::system::error_code;
    /// Runs an operation, which `start` gives a handler, until it ends or `end` is reached.
    template <class Start>
    [[nodiscard]] ErrorCode wait(Start start, Time end);
    [[nodiscard]] Fetched<void> handshake(Time end);

    const Origin origin_;
    const Trust trust_;
    const std::function<bool()>& isStopped_;
    boost::asio::io_context io_{1};
    NetStream stream_;
};

/// Returns the sentence for an error of a connection.
[[nodiscard]] std::string causeOf(const boost::system::error_code& error);
/// Returns the failure of a server that did not answer.
[[nodiscard]] tl::unexpected<Failure> unreachable(std::string cause,
                                                  const boost::system::error_code& error = {});

}  // namespace usdlive::fetch
