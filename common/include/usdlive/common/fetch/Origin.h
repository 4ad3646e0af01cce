// The scheme, host and port of a server that answers HTTP.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "usdlive/common/fetch/Fetched.h"

namespace usdlive::fetch {

/// A server, as in the first part of a URL: `http://HOST:PORT`.
struct Origin {
    std::string host;  ///< a name in lower case, or an address; IPv6 without its brackets
    std::uint16_t port = 0;
    bool isSecure = false;  ///< https

    bool operator==(const Origin&) const = default;

    /// Returns the host, an IPv6 address with brackets.
    [[nodiscard]] std::string hostInUrl() const;
    /// Returns the value of the header Host: without the port if it is that of the scheme.
    [[nodiscard]] std::string hostAndPort() const;
    [[nodiscard]] std::string url() const;
};

/// Returns a host's name in lower case, or an IPv6 address, which is written in brackets, without
/// them and as it is written everywhere. Empty if the text is neither.
[[nodiscard]] std::string hostOf(std::string_view text);
/// Parses `HOST`, `HOST:PORT`, `[IPV6]` and `[IPV6]:PORT`. `port` is the one of a text without.
[[nodiscard]] Fetched<Origin> parseOrigin(std::string_view text, std::uint16_t port);

/// True for `localhost` and addresses of the loopback interface.
[[nodiscard]] bool isLoopback(const std::string& host);

}  // namespace usdlive::fetch
