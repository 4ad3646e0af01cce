// The names under which the server answers HTTP requests.
#pragma once

#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

namespace usdlive::server {

/// Returns whether the text is an address of IPv4 or IPv6, without brackets.
[[nodiscard]] bool isAddress(const std::string& text);

/// Returns the host of a header `Host`, in lower case and without port, brackets and final dot.
/// Returns nothing if the text is no host.
[[nodiscard]] std::optional<std::string> hostOf(std::string_view header);

/// Returns the names of this machine: of the system, also with ".local" and, unless
/// `isLoopbackOnly`, with the domain that the system's name service knows. May wait for that
/// service.
[[nodiscard]] std::vector<std::string> namesOfThisMachine(bool isLoopbackOnly);

/// Decides which requests are for this server (HO1). A web page can give its own name the address
/// of this server (DNS rebinding). The browser then lets the page read the answers, as those of its
/// own site, and sends that name as `Host`. A page cannot do this with an address in place of a
/// name, so every address is allowed: it may be the one of a router or container host that passes
/// the connection on.
class HostNames {
public:
    /// `names`: of this machine, and those of --allow-host; "*" allows all.
    explicit HostNames(const std::vector<std::string>& names);

    /// `host` is a hostOf(). localhost and names below it are always allowed.
    [[nodiscard]] bool allows(const std::string& host) const;

private:
    std::set<std::string> names_;
};

}  // namespace usdlive::server
