// Writes and parses invitations.
#include "usdlive/common/net/Invitation.h"

#include <algorithm>
#include <cctype>
#include <charconv>

namespace usdlive {

namespace {

constexpr std::string_view kScheme = "usdlive-invitation://", kTokenScheme = "usdlive-token://";
constexpr std::string_view kTls = "tls", kPin = "pin=", kSha256 = "sha256:";
constexpr std::size_t kHexDigits = 64;

tl::unexpected<Error> damaged(std::string_view scheme, const std::string& why) {
    return fail(ErrorCode::InvalidArgument,
                "the " + std::string(scheme == kScheme ? "invitation" : "token") +
                    " is damaged: " + why + ". Copy all of it, from " + std::string(scheme) +
                    " to its last character");
}

bool isHex(std::string_view text) {
    return text.size() == kHexDigits && std::ranges::all_of(text, [](char c) {
               return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f');
           });
}

bool isHost(std::string_view host) {
    return !host.empty() && std::ranges::all_of(host, [](char c) {
        return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') ||
               std::string_view(".-_:").find(c) != std::string_view::npos;
    });
}

std::string_view trimmed(std::string_view text) {
    const auto begin = text.find_first_not_of(" \t\r\n");
    if (begin == std::string_view::npos) return {};
    return text.substr(begin, text.find_last_not_of(" \t\r\n") + 1 - begin);
}

/// Parses `HOST:PORT/CODE`, with what follows a text that begins with the scheme.
Result<Invitation> placeIn(std::string_view rest, std::string_view scheme) {
    const auto invalid = [scheme](const char* why) { return damaged(scheme, why); };
    Invitation invitation;
    const auto slash = rest.find('/');
    if (slash == std::string_view::npos) return invalid("it has no code");
    std::string authority(rest.substr(0, slash));
    std::ranges::transform(authority, authority.begin(),
                           [](unsigned char c) { return char(std::tolower(c)); });
    const auto colon = authority.rfind(':');
    if (colon == std::string::npos) return invalid("it names no port");
    invitation.host = authority.substr(0, colon);
    if (invitation.host.starts_with('[') && invitation.host.ends_with(']'))
        invitation.host = invitation.host.substr(1, invitation.host.size() - 2);
    if (!isHost(invitation.host)) return invalid("it names no server");
    const char* const end = authority.data() + authority.size();
    const auto [read, error] = std::from_chars(authority.data() + colon + 1, end, invitation.port);
    if (error != std::errc{} || read != end || invitation.port == 0)
        return invalid("it names no port");
    rest.remove_prefix(slash + 1);
    const auto mark = rest.find('?');
    invitation.code = rest.substr(0, mark);
    if (!isHex(invitation.code)) return invalid("its code is not complete");
    if (mark == std::string_view::npos) return invitation;
    rest.remove_prefix(mark + 1);
    invitation.isTls = true;
    if (rest == kTls) return invitation;
    if (rest.starts_with(kPin)) invitation.pin = rest.substr(kPin.size());
    if (!invitation.pin.starts_with(kSha256) ||
        !isHex(std::string_view(invitation.pin).substr(kSha256.size())))
        return invalid("the fingerprint of the server is not complete");
    return invitation;
}

std::string textOf(const Invitation& invitation, const std::string& begin) {
    const auto& [host, port, code, isTls, pin] = invitation;
    const bool isV6 = host.find(':') != std::string::npos;
    std::string all =
        begin + (isV6 ? "[" + host + "]" : host) + ":" + std::to_string(port) + "/" + code;
    if (!pin.empty()) return all + "?" + std::string(kPin) + pin;
    return isTls ? all + "?" + std::string(kTls) : all;
}

}  // namespace

std::string Invitation::text() const { return textOf(*this, std::string(kScheme)); }

std::string ServiceToken::text() const {
    return textOf(place, std::string(kTokenScheme) + user + "@");
}

bool isInvitation(std::string_view text) { return trimmed(text).starts_with(kScheme); }

Result<Invitation> parseInvitation(std::string_view pasted) {
    const std::string_view text = trimmed(pasted);
    if (!text.starts_with(kScheme))
        return damaged(kScheme, "it does not begin with " + std::string(kScheme));
    return placeIn(text.substr(kScheme.size()), kScheme);
}

Result<ServiceToken> parseServiceToken(std::string_view pasted) {
    std::string_view text = trimmed(pasted);
    if (!text.starts_with(kTokenScheme))
        return damaged(kTokenScheme, "it does not begin with " + std::string(kTokenScheme));
    text.remove_prefix(kTokenScheme.size());
    const auto end = text.substr(0, text.find('/')).rfind('@');
    if (end == std::string_view::npos || end == 0)
        return damaged(kTokenScheme, "it names no account");
    return placeIn(text.substr(end + 1), kTokenScheme).map([&](Invitation place) {
        return ServiceToken{std::string(text.substr(0, end)), std::move(place)};
    });
}

}  // namespace usdlive
