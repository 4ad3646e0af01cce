// URLs of other services, such as an issuer.
#pragma once

#include <string>
#include <string_view>

#include "usdlive/common/fetch/Origin.h"

namespace usdlive::fetch {

struct ServiceUrl {
    Origin origin;
    std::string target;  ///< path and query; begins with a slash

    bool operator==(const ServiceUrl&) const = default;
};

/// Parses `https://HOST[:PORT][/PATH][?QUERY]`; with `http` only for a host of this machine. It may
/// have no user, no fragment, and only printable ASCII. The failure can follow "URL: ".
[[nodiscard]] Fetched<ServiceUrl> parseServiceUrl(std::string_view text);

}  // namespace usdlive::fetch
