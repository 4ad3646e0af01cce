// Compares the hosts of requests with the names of the server.
#include "transport/HostNames.h"

#include <netdb.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <boost/asio/ip/address.hpp>
#include <memory>

namespace usdlive::server {

namespace {

constexpr std::size_t kMostBytes = 253;  // RFC 1035

bool isDigit(char character) { return character >= '0' && character <= '9'; }
bool isNameCharacter(char character) {
    return isDigit(character) || (character >= 'a' && character <= 'z') || character == '-' ||
           character == '_' || character == '.';
}

std::string lowerCase(std::string_view text) {
    std::string lower(text);
    for (char& character : lower)
        if (character >= 'A' && character <= 'Z') character = char(character - 'A' + 'a');
    return lower;
}

bool isPort(std::string_view text) {
    return text.size() <= 5 && std::ranges::all_of(text, isDigit);
}

}  // namespace

bool isAddress(const std::string& text) {
    boost::system::error_code error;
    (void)boost::asio::ip::make_address(text, error);
    return !error;
}

std::optional<std::string> hostOf(std::string_view header) {
    const bool isBracketed = header.starts_with('[');
    const std::size_t end =
        isBracketed ? header.find(']') : std::min(header.find(':'), header.size());
    if (end == std::string_view::npos) return std::nullopt;
    std::string host = lowerCase(header.substr(isBracketed ? 1 : 0, end - (isBracketed ? 1 : 0)));
    const std::string_view rest = header.substr(isBracketed ? end + 1 : end);
    if (!rest.empty() && (rest.front() != ':' || !isPort(rest.substr(1)))) return std::nullopt;
    if (isBracketed) return isAddress(host) ? std::optional(host) : std::nullopt;
    if (host.ends_with('.')) host.pop_back();
    if (host.empty() || host.size() > kMostBytes || !std::ranges::all_of(host, isNameCharacter))
        return std::nullopt;
    return host;
}

std::vector<std::string> namesOfThisMachine(bool isLoopbackOnly) {
    std::array<char, kMostBytes + 3> buffer{};
    if (::gethostname(buffer.data(), buffer.size() - 1) != 0) return {};
    const std::string name = buffer.data();
    std::vector<std::string> names{name, name.substr(0, name.find('.')) + ".local"};
    if (isLoopbackOnly) return names;
    addrinfo hints{};
    hints.ai_flags = AI_CANONNAME;
    addrinfo* found = nullptr;
    if (::getaddrinfo(name.c_str(), nullptr, &hints, &found) != 0) return names;
    const std::unique_ptr<addrinfo, decltype(&::freeaddrinfo)> owned(found, &::freeaddrinfo);
    if (found->ai_canonname) names.emplace_back(found->ai_canonname);
    return names;
}

HostNames::HostNames(const std::vector<std::string>& names) {
    for (const std::string& name : names)
        names_.insert(name == "*" ? name : hostOf(name).value_or(""));
}

bool HostNames::allows(const std::string& host) const {
    return host == "localhost" || host.ends_with(".localhost") || isAddress(host) ||
           names_.contains(host) || names_.contains("*");
}

}  // namespace usdlive::server
