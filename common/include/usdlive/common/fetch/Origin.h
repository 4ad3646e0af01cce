// The scheme, host and port of a server that answers HTTP.
#pragma once

#include <cstdint>
#include <string>

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

/// True for `localhost` and addresses of the loopback interface.
[[nodiscard]] bool isLoopback(const std::string& host);

}  // namespace usdlive::fetch
