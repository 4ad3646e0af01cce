// The servers that the programs of this user know: tokens, and certificates that were seen before.
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>

#include "usdlive/common/core/Descriptor.h"
#include "usdlive/common/core/Result.h"

namespace usdlive {

/// The way to a new token from the issuer that gave the present one (AC26).
struct TokenRenewal {
    std::string tokensUrl;     ///< at the issuer
    std::string clientId;      ///< the id of usdlive there
    std::string refreshToken;  ///< empty: the user has to sign in again
    std::int64_t endsAt = 0;   ///< the end of the present token, in seconds since 1970

    bool operator==(const TokenRenewal&) const = default;
};

/// The facts about one server that are kept for the next connection.
struct KnownServer {
    std::string user;    ///< the name that belongs to the token; may be empty
    std::string token;   ///< empty: none
    std::string pin;     ///< `sha256:HEX` of its certificate, kSignedByAuthority, or empty
    bool isTls = false;  ///< connections to it are encrypted
    std::optional<TokenRenewal> renewal = {};  ///< nothing: the token does not end by itself

    bool operator==(const KnownServer&) const = default;
};

/// The pin of a server whose certificate an authority has signed. Such certificates are renewed, so
/// their fingerprints are not kept.
inline constexpr const char* kSignedByAuthority = "authority";

/// Returns `host:port`, with the host in lower case and an IPv6 address in brackets.
[[nodiscard]] std::string serverName(const std::string& host, std::uint16_t port);
/// Returns whether the host is this machine: `localhost`, `127.0.0.1`, `::1` and their like.
[[nodiscard]] bool isLoopbackHost(const std::string& host);

/// The file `servers.json`, which all processes of this user read and change. Nothing is cached:
/// each call reads the file. Any thread. Processes that change it at the same time wait for each
/// other.
///
/// Errors are InvalidConfiguration and name the file: it cannot be read or written, it is not
/// valid, or others can read it.
class KnownServers {
public:
    /// Returns `$XDG_CONFIG_HOME/usdlive`, or `~/.config/usdlive`. Empty if neither variable is
    /// set.
    [[nodiscard]] static std::filesystem::path folderOfUser();

    /// An empty folder knows no server and cannot keep one.
    explicit KnownServers(std::filesystem::path folder = folderOfUser());

    /// Returns what is known about a server. The token of a service account for this server comes
    /// before the one in the file: it is the value of the environment variable USDLIVE_TOKEN, or
    /// the content of the file that USDLIVE_TOKEN_FILE names (AC12).
    [[nodiscard]] Result<std::optional<KnownServer>> find(const std::string& host,
                                                          std::uint16_t port) const;
    /// Replaces what is known about a server.
    [[nodiscard]] Result<void> keep(const std::string& host, std::uint16_t port,
                                    const KnownServer& server) const;
    /// Changes a part of what is known about a server. `change` gets an empty entry for a new one.
    [[nodiscard]] Result<void> update(const std::string& host, std::uint16_t port,
                                      const std::function<void(KnownServer&)>& change) const;
    /// Returns whether the server was known.
    [[nodiscard]] Result<bool> forget(const std::string& host, std::uint16_t port) const;

    /// Returns the token that a server at this port of this machine has written for its owner, in
    /// `local/PORT`. Returns nothing if the file is not one that only this user can read and write.
    [[nodiscard]] std::optional<std::string> ownerToken(std::uint16_t port) const;

    /// Lets one process at a time renew tokens, until the result is destroyed: an issuer may accept
    /// a refresh token once only. Waits for `limit` at most, and not after `isStopped`, which may
    /// be empty, returns true. Returns nothing if another process still renews.
    [[nodiscard]] Result<std::optional<Descriptor>> lockRenewal(
        std::chrono::milliseconds limit, const std::function<bool()>& isStopped = {}) const;

    /// Returns the value of the header Authorization for a request to this server, or nothing. A
    /// token that belongs to an encrypted connection is not sent over a plain one. Does not renew
    /// the token: see fetch::authorizationFor().
    [[nodiscard]] Result<std::optional<std::string>> authorization(const std::string& host,
                                                                   std::uint16_t port,
                                                                   bool isEncrypted) const;

private:
    [[nodiscard]] Result<std::optional<KnownServer>> kept(const std::string& host,
                                                          std::uint16_t port) const;

    std::filesystem::path folder_;
};

}  // namespace usdlive
