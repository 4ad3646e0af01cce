// Signs in at a server with its OpenID Connect issuer, and keeps the sign-in fresh.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>

#include "usdlive/common/core/Result.h"
#include "usdlive/common/fetch/Join.h"
#include "usdlive/common/fetch/Origin.h"

namespace usdlive::fetch {

/// The question of the issuer, which the user answers in a browser, on any machine.
struct DevicePrompt {
    std::string issuer;           ///< its URL, so that users see where they sign in
    std::string address;          ///< to open
    std::string completeAddress;  ///< the same with the code in it; may be empty
    std::string code;             ///< to enter there
    std::chrono::seconds time{};  ///< until which it can be answered
};

/// Signs in at a server by the device flow (RFC 8628), and keeps the token in KnownServers, so that
/// all programs of this user sign in from now on (AC26). `isEncrypted`: `wss://`. Calls `show`
/// once, then waits for the user's answer: as long as the issuer allows, often 10 minutes, or until
/// `isStopped`, which may be empty, returns true. Any thread. Errors: SignInRequired (the issuer or
/// the server refuses), NotConnected (one of them cannot be reached, or the connection is not
/// encrypted), InvalidConfiguration (the token cannot be kept).
[[nodiscard]] Result<JoinedServer> login(const std::string& host, std::uint16_t port,
                                         bool isEncrypted,
                                         const std::function<void(const DevicePrompt&)>& show,
                                         const std::function<bool()>& isStopped = {});

/// Returns the value of the header Authorization for a request to a server, or nothing, as
/// KnownServers::authorization() does. Asks the issuer for a new token first if the present one
/// ends within 30 s; blocks for at most 12 s then, and not after `isStopped`, which may be empty,
/// returns true. Any thread. Errors: SignInRequired if the token has ended and no new one was
/// given; it says what to do. Also those of KnownServers.
[[nodiscard]] Result<std::optional<std::string>> authorizationFor(
    const std::string& host, std::uint16_t port, bool isEncrypted,
    const std::function<bool()>& isStopped = {});

}  // namespace usdlive::fetch
