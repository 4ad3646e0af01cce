// Reads addresses of services, and decides which ones a scene may use.
#include "Address.h"

#include <algorithm>

namespace usdlive::edf::museum {

namespace {

constexpr std::string_view kPlain = "http://", kSecure = "https://";
constexpr std::uint16_t kPlainPort = 80, kSecurePort = 443;
constexpr std::string_view kVariable = "USDLIVE_EDF_MUSEUM_URL",
                           kAllowedVariable = "USDLIVE_EDF_ALLOWED_HOSTS";

std::string lower(std::string_view text) {
    std::string out(text);
    std::ranges::transform(out, out.begin(),
                           [](char c) { return c >= 'A' && c <= 'Z' ? char(c - 'A' + 'a') : c; });
    return out;
}

bool isPathChar(char c) { return c > ' ' && c < 0x7f && c != '?' && c != '#' && c != '@'; }

}  // namespace

tl::expected<Address, std::string> readAddress(std::string_view text) {
    const auto wrong = [&](const std::string& why) {
        return tl::unexpected("the address '" + std::string(text.substr(0, 200)) +
                              "' cannot be used: " + why);
    };
    Address address;
    const bool isSecure = lower(text.substr(0, kSecure.size())) == kSecure;
    const std::string_view scheme = isSecure ? kSecure : kPlain;
    if (lower(text.substr(0, scheme.size())) != scheme)
        return wrong("it does not begin with http:// or https://");
    const std::string_view rest = text.substr(scheme.size());
    const auto slash = std::min(rest.find('/'), rest.size());
    address.path = rest.substr(slash);
    while (address.path.ends_with('/')) address.path.pop_back();
    const auto origin =
        fetch::parseOrigin(rest.substr(0, slash), isSecure ? kSecurePort : kPlainPort);
    if (!origin) return wrong(origin.error().cause);
    address.origin = *origin;
    address.origin.isSecure = isSecure;
    if (!std::ranges::all_of(address.path, isPathChar))
        return wrong("its path has characters that are not allowed");
    return address;
}

bool isAllowed(const Address& address, std::string_view list) {
    while (!list.empty()) {
        const auto comma = std::min(list.find(','), list.size());
        std::string one = lower(list.substr(0, comma));
        std::erase(one, ' ');
        const std::string host = address.origin.hostInUrl();
        if (!one.empty() &&
            (one == host || one == host + ":" + std::to_string(address.origin.port)))
            return true;
        list.remove_prefix(std::min(comma + 1, list.size()));
    }
    return false;
}

tl::expected<Address, std::string> chooseAddress(const std::string& ofScene, const std::string& own,
                                                 const std::string& allowed) {
    if (own.empty() && ofScene.empty())
        return tl::unexpected("no address: set " + std::string(kVariable) +
                              " to the base address of the collection, " +
                              "for example http://localhost:8080/public/collection/v1");
    if (ofScene.empty()) return readAddress(own);
    auto address = readAddress(ofScene);
    if (!address) return address;
    const auto ownAddress = own.empty() ? tl::unexpected(std::string()) : readAddress(own);
    const bool isOwn = ownAddress && ownAddress->text() == address->text();
    if (isOwn || isAllowed(*address, allowed)) return address;
    return tl::unexpected("the host of baseAddress, " + address->origin.hostAndPort() +
                          ", is not allowed. Allow it with " + std::string(kAllowedVariable) + "=" +
                          address->origin.hostInUrl());
}

}  // namespace usdlive::edf::museum
