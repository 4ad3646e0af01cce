// Writes the first part of a URL.
#include "usdlive/common/fetch/Origin.h"

#include <arpa/inet.h>
#include <netinet/in.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <string_view>
#include <system_error>

namespace usdlive::fetch {

namespace {

constexpr std::uint16_t kPlainPort = 80, kSecurePort = 443;

/// Returns the IPv6 address as it is written everywhere, or an empty text if it is none.
std::string addressOfIpv6(std::string_view text) {
    in6_addr bytes{};
    std::array<char, INET6_ADDRSTRLEN> written{};
    if (::inet_pton(AF_INET6, std::string(text).c_str(), &bytes) != 1 ||
        !::inet_ntop(AF_INET6, &bytes, written.data(), written.size()))
        return {};
    return written.data();
}

}  // namespace

std::string Origin::hostInUrl() const {
    return host.find(':') != std::string::npos ? "[" + host + "]" : host;
}

std::string Origin::hostAndPort() const {
    const bool isUsual = port == (isSecure ? kSecurePort : kPlainPort);
    return hostInUrl() + (isUsual ? "" : ":" + std::to_string(port));
}

std::string Origin::url() const { return (isSecure ? "https://" : "http://") + hostAndPort(); }

std::string hostOf(std::string_view text) {
    const auto isInName = [](char c) {
        return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
               c == '-' || c == '.' || c == '_';
    };
    if (text.starts_with('[') && text.ends_with(']'))
        return addressOfIpv6(text.substr(1, text.size() - 2));
    std::string host;
    if (std::ranges::all_of(text, isInName))
        for (const char c : text) host += c >= 'A' && c <= 'Z' ? char(c - 'A' + 'a') : c;
    return host;
}

Fetched<Origin> parseOrigin(std::string_view text, std::uint16_t port) {
    const std::size_t bracket = text.starts_with('[') ? text.find(']') : 0;
    const std::size_t colon = text.find(':', bracket == std::string_view::npos ? 0 : bracket);
    Origin origin{hostOf(text.substr(0, colon)), port};
    if (origin.host.empty()) return failed("it names no host");
    if (colon == std::string_view::npos) return origin;
    const char* const end = text.data() + text.size();
    const auto [read, error] = std::from_chars(text.data() + colon + 1, end, origin.port);
    if (error != std::errc() || read != end || origin.port == 0)
        return failed("its port is not a number from 1 to 65535");
    return origin;
}

bool isLoopback(const std::string& host) {
    constexpr std::uint32_t kLoopbackNet = 127;
    in_addr v4{};
    in6_addr v6{};
    if (host == "localhost") return true;
    if (::inet_pton(AF_INET, host.c_str(), &v4) == 1) return ntohl(v4.s_addr) >> 24 == kLoopbackNet;
    return ::inet_pton(AF_INET6, host.c_str(), &v6) == 1 && IN6_IS_ADDR_LOOPBACK(&v6);
}

}  // namespace usdlive::fetch
