// Writes the first part of a URL.
#include "usdlive/common/fetch/Origin.h"

#include <arpa/inet.h>
#include <netinet/in.h>

#include <string_view>

namespace usdlive::fetch {

namespace {

constexpr std::uint16_t kPlainPort = 80, kSecurePort = 443;

}  // namespace

std::string Origin::hostInUrl() const {
    return host.find(':') != std::string::npos ? "[" + host + "]" : host;
}

std::string Origin::hostAndPort() const {
    const bool isUsual = port == (isSecure ? kSecurePort : kPlainPort);
    return hostInUrl() + (isUsual ? "" : ":" + std::to_string(port));
}

std::string Origin::url() const { return (isSecure ? "https://" : "http://") + hostAndPort(); }

bool isLoopback(const std::string& host) {
    constexpr std::uint32_t kLoopbackNet = 127;
    in_addr v4{};
    in6_addr v6{};
    if (host == "localhost") return true;
    if (::inet_pton(AF_INET, host.c_str(), &v4) == 1) return ntohl(v4.s_addr) >> 24 == kLoopbackNet;
    return ::inet_pton(AF_INET6, host.c_str(), &v6) == 1 && IN6_IS_ADDR_LOOPBACK(&v6);
}

}  // namespace usdlive::fetch
