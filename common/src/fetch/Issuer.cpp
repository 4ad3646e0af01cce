// Reads the discovery document of an issuer.
#include "usdlive/common/fetch/Issuer.h"

#include <nlohmann/json.hpp>

namespace usdlive::fetch {

namespace {

using Json = nlohmann::json;

constexpr unsigned kFound = 200;
constexpr const char* kDocument = "/.well-known/openid-configuration";

std::string memberOf(const Json& document, const char* name) {
    const auto found = document.find(name);
    return found != document.end() && found->is_string() ? found->get<std::string>() : "";
}

Fetched<ServiceUrl> urlIn(const Json& document, const char* name) {
    const std::string text = memberOf(document, name);
    if (text.empty()) return failed("its configuration has no \"" + std::string(name) + "\"");
    auto url = parseServiceUrl(text);
    if (!url)
        return failed("\"" + std::string(name) +
                      "\" of its configuration cannot be used: " + url.error().cause);
    return url;
}

}  // namespace

HttpLimits issuerLimits() {
    using std::chrono::milliseconds;
    HttpLimits limits;
    limits.connect = milliseconds(3'000);
    limits.whole = milliseconds(5'000);
    limits.bodyBytes = 256 * 1024;
    return limits;
}

Fetched<Issuer> discover(const std::string& url, const std::function<bool()>& isStopped) {
    const bool endsWithSlash = url.ends_with('/');
    const auto place = parseServiceUrl(url + (endsWithSlash ? kDocument + 1 : kDocument));
    if (!place) return failed("its URL cannot be used: " + place.error().cause);
    const auto answer =
        get({.origin = place->origin, .target = place->target}, issuerLimits(), isStopped);
    if (!answer) return tl::unexpected(answer.error());
    if (answer->status != kFound)
        return failed("it answered HTTP " + std::to_string(answer->status) + " to " + place->target,
                      answer->status);
    const Json document = Json::parse(answer->body, nullptr, false);
    if (!document.is_object()) return failed(place->target + " is not JSON");
    if (memberOf(document, "issuer") != url)
        return failed(
            "its configuration is that of another issuer; the URLs have to be equal, also in a "
            "slash at their end");
    auto keys = urlIn(document, "jwks_uri"), tokens = urlIn(document, "token_endpoint");
    if (!keys) return tl::unexpected(keys.error());
    if (!tokens) return tl::unexpected(tokens.error());
    Issuer issuer{
        std::move(*keys), std::move(*tokens), memberOf(document, "token_endpoint"), {}, {}};
    constexpr const char* kDevices = "device_authorization_endpoint";
    if (document.contains(kDevices)) {
        auto devices = urlIn(document, kDevices);
        if (!devices) return tl::unexpected(devices.error());
        issuer.devices = std::move(*devices);
    }
    if (const auto scopes = document.find("scopes_supported");
        scopes != document.end() && scopes->is_array())
        for (const Json& scope : *scopes)
            if (scope.is_string()) issuer.scopes.push_back(scope.get<std::string>());
    return issuer;
}

}  // namespace usdlive::fetch
