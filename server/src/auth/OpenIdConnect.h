// Checks the tokens that an OpenID Connect issuer has signed.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <tl/expected.hpp>
#include <vector>

#include "usdlive/common/core/Id.h"
#include "usdlive/common/core/Result.h"

struct evp_pkey_st;

namespace usdlive::server {

/// The public keys with which an issuer signs. A value; copies share the keys. Any thread, one at a
/// time.
class IssuerKeys {
public:
    /// Larger sets are refused before they are parsed.
    static constexpr std::size_t kMostBytes = 256 * 1024;

    /// No keys: no token is accepted.
    IssuerKeys() = default;
    /// Parses a JWK Set (RFC 7517). Keys that cannot check a signature of this class are known by
    /// their id only. Error: InvalidConfiguration says what is wrong; also if no key can be used.
    [[nodiscard]] static Result<IssuerKeys> parse(std::string_view text);

    /// The algorithms that are accepted (AC20).
    enum class Algorithm { Rs256, Es256, EdDsa };
    struct Key {
        std::optional<std::string> id;
        std::optional<Algorithm> algorithm;  ///< nothing: for another purpose
        bool isShort = false;                ///< RSA with fewer than 2048 bits
        std::shared_ptr<evp_pkey_st> key;    ///< nullptr if it is short, or for another purpose
    };
    [[nodiscard]] const std::vector<Key>& keys() const { return keys_; }

private:
    std::vector<Key> keys_;
};

/// The reasons for which a token is refused. describe() says each as a sentence.
enum class TokenProblem {
    TooLong,
    NotThreeParts,
    NotBase64Url,
    NotJson,
    MemberTwice,
    TooDeep,
    NotAnObject,
    OtherType,
    Critical,
    Algorithm,
    KeyIdNotText,
    UnknownKey,  ///< the issuer may have newer keys
    KeyNotNamed,
    KeyUnfit,
    KeyTooShort,
    Signature,
    Issuer,
    Audience,
    NoExpiry,
    TimeNotValid,
    Expired,
    NotYetValid,
    NoSubject,
    NoUser,
    UserNotValid,
    EmailNotVerified,
    GroupsNotValid,
    GroupsLeftOut,
};

/// Returns a sentence for the log. It has nothing of the token.
[[nodiscard]] std::string_view describe(TokenProblem problem);

/// The conditions for tokens of one issuer (AC21, AC22). A claim that begins with a slash is a JSON
/// pointer to one in an object: `/realm_access/roles`.
struct IssuerRules {
    std::string issuer;
    std::string audience;
    std::string userClaim = "email";
    std::string groupsClaim = "groups";
};

/// Returns an error if the text cannot be the name of a claim.
[[nodiscard]] Result<void> checkClaim(std::string_view name);

/// The statements of a token that was accepted.
struct IssuedIdentity {
    UserName user;
    std::set<std::string> groups;
    std::int64_t endsAt = 0;  ///< seconds since 1970
};

/// Longer tokens are refused before anything of them is read.
inline constexpr std::size_t kMostTokenBytes = 16 * 1024;
/// The clock of the issuer may be ahead by so much.
inline constexpr std::int64_t kClockLeeway = 60;

/// Returns whether a text can only be meant as a token of an issuer: it has two dots.
[[nodiscard]] bool isIssuedToken(std::string_view token);
/// AC20-AC22: decides about a token at a time, in seconds since 1970. No I/O, no state.
[[nodiscard]] tl::expected<IssuedIdentity, TokenProblem> checkIssuedToken(std::string_view token,
                                                                          const IssuerKeys& keys,
                                                                          const IssuerRules& rules,
                                                                          std::int64_t now);

}  // namespace usdlive::server
