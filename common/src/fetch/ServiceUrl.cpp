// Parses URLs of services that are trusted with tokens.
#include "usdlive/common/fetch/ServiceUrl.h"

#include <algorithm>

namespace usdlive::fetch {

namespace {

constexpr std::string_view kHttp = "http://", kHttps = "https://";
constexpr std::uint16_t kHttpPort = 80, kHttpsPort = 443;
constexpr std::size_t kMostUrlBytes = 2'048;

}  // namespace

Fetched<ServiceUrl> parseServiceUrl(std::string_view text) {
    const bool isSecure = text.starts_with(kHttps);
    if (!isSecure && !text.starts_with(kHttp)) return failed("it does not begin with https://");
    if (text.size() > kMostUrlBytes || !std::ranges::all_of(text, [](char c) {
            return c > ' ' && c <= '~' && c != '"' && c != '<' && c != '>' && c != '\\' && c != '#';
        }))
        return failed("it has characters that a URL cannot have, or is too long");
    const std::string_view rest = text.substr(isSecure ? kHttps.size() : kHttp.size());
    const auto slash = std::min(rest.find_first_of("/?"), rest.size());
    const std::string_view target = rest.substr(slash);
    auto origin = parseOrigin(rest.substr(0, slash), isSecure ? kHttpsPort : kHttpPort);
    if (!origin) return tl::unexpected(origin.error());
    origin->isSecure = isSecure;
    if (!isSecure && !isLoopback(origin->host))
        return failed("it is not encrypted: it has to begin with https://");
    return ServiceUrl{std::move(*origin),
                      (target.starts_with('/') ? "" : "/") + std::string(target)};
}

}  // namespace usdlive::fetch
