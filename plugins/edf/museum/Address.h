// Addresses of REST services, and which of them a scene may use.
#pragma once

#include <string>
#include <string_view>
#include <tl/expected.hpp>

#include "usdlive/common/fetch/Origin.h"

namespace usdlive::edf::museum {

/// The base of a service: http[s]://host[:port][/path].
struct Address {
    fetch::Origin origin;
    std::string path;  ///< without a slash at its end

    /// The name of the service in messages and in the cache.
    [[nodiscard]] std::string text() const { return origin.url() + path; }
};

/// Reads an address; the error names what is wrong. User names, queries and fragments are refused.
[[nodiscard]] tl::expected<Address, std::string> readAddress(std::string_view text);

/// True if the list, texts HOST or HOST:PORT with commas between, has the address. HOST alone means
/// all ports.
[[nodiscard]] bool isAllowed(const Address& address, std::string_view list);

/// Chooses the address of a payload. `own` is that of the machine's owner (the environment) and
/// always allowed. A scene may ask for it, or for a host in `allowed`, because a scene comes from
/// anywhere and must not reach what only this machine can reach.
[[nodiscard]] tl::expected<Address, std::string> chooseAddress(const std::string& ofScene,
                                                               const std::string& own,
                                                               const std::string& allowed);

}  // namespace usdlive::edf::museum
