// The texts with which persons join a server, and programs sign in.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "usdlive/common/core/Result.h"

namespace usdlive {

/// An invitation (AC2). Its text is `usdlive-invitation://HOST:PORT/CODE`, with `?tls` or
/// `?pin=sha256:HEX` if the server speaks TLS.
struct Invitation {
    std::string host;  ///< in lower case; IPv6 without brackets
    std::uint16_t port = 0;
    std::string code;  ///< 64 hexadecimal digits
    bool isTls = false;
    std::string pin;  ///< `sha256:HEX` of the server's certificate; empty: an authority signed it

    bool operator==(const Invitation&) const = default;
    [[nodiscard]] std::string text() const;
};

/// Returns whether the text is meant to be an invitation.
[[nodiscard]] bool isInvitation(std::string_view text);
/// Parses the result of text(), with space around it. Error: InvalidArgument. It does not show the
/// code.
[[nodiscard]] Result<Invitation> parseInvitation(std::string_view text);

/// The token of a service account (AC12), with the server to which alone it is sent. Its text is
/// that of an invitation with the name of the account: `usdlive-token://NAME@HOST:PORT/TOKEN`.
struct ServiceToken {
    std::string user;
    Invitation place;  ///< its code is the token

    bool operator==(const ServiceToken&) const = default;
    [[nodiscard]] std::string text() const;
};
/// Parses the result of text(), with space around it. Error: InvalidArgument. It does not show the
/// token.
[[nodiscard]] Result<ServiceToken> parseServiceToken(std::string_view text);

}  // namespace usdlive
