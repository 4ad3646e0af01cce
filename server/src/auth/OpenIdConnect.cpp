// Checks signatures and claims. Nothing of the claims is read before the signature is known to be
// the issuer's.
#include "auth/OpenIdConnect.h"

#include <openssl/bn.h>
#include <openssl/ecdsa.h>
#include <openssl/err.h>
#include <openssl/evp.h>

#include <algorithm>
#include <array>
#include <memory>
#include <new>
#include <nlohmann/json.hpp>

#include "auth/Accounts.h"
#include "auth/StrictJson.h"
#include "usdlive/common/core/Base64Url.h"
#include "usdlive/common/core/Utf8.h"

namespace usdlive::server {

namespace {

using Json = nlohmann::json;
using Algorithm = IssuerKeys::Algorithm;
using Key = IssuerKeys::Key;
template <class T>
using Checked = tl::expected<T, TokenProblem>;
using Refused = tl::unexpected<TokenProblem>;

constexpr std::size_t kMostGroups = 1'000, kMostGroupBytes = 1'024, kMostSubjectBytes = 255;
constexpr std::int64_t kLastTime = 253'402'300'799;  // the end of the year 9999
constexpr std::size_t kHalfSignature = 32;           // one of the two numbers of ES256
constexpr const char* kEmail = "email";

// ---- the form

struct Parts {
    std::string_view header, claims, signature;
    std::string_view signedText;  ///< header and claims, with the dot
};

Checked<Parts> split(std::string_view token) {
    const auto first = token.find('.'), second = token.find('.', first + 1);
    if (first == std::string_view::npos || second == std::string_view::npos ||
        token.find('.', second + 1) != std::string_view::npos)
        return Refused(TokenProblem::NotThreeParts);
    const Parts parts{token.substr(0, first), token.substr(first + 1, second - first - 1),
                      token.substr(second + 1), token.substr(0, second)};
    if (parts.header.empty() || parts.claims.empty() || parts.signature.empty())
        return Refused(TokenProblem::NotThreeParts);
    return parts;
}

Checked<Json> objectIn(std::string_view part) {
    const auto bytes = base64UrlDecoded(part);
    if (!bytes) return Refused(TokenProblem::NotBase64Url);
    auto json = parseStrictly({reinterpret_cast<const char*>(bytes->data()), bytes->size()});
    if (json) return std::move(*json);
    switch (json.error()) {
        case JsonProblem::MemberTwice:
            return Refused(TokenProblem::MemberTwice);
        case JsonProblem::TooDeep:
            return Refused(TokenProblem::TooDeep);
        case JsonProblem::NotAnObject:
            return Refused(TokenProblem::NotAnObject);
        default:
            return Refused(TokenProblem::NotJson);
    }
}

// ---- the header

/// Tokens of other purposes may have the same issuer, audience and keys, such as one that ends a
/// sign-in (`logout+jwt`).
bool isTypeOfSignIn(const Json& header) {
    const auto type = header.find("typ");
    if (type == header.end()) return true;
    if (!type->is_string()) return false;
    std::string name = type->get<std::string>();
    std::ranges::transform(name, name.begin(),
                           [](char c) { return c >= 'A' && c <= 'Z' ? char(c - 'A' + 'a') : c; });
    if (name.starts_with("application/")) name.erase(0, std::string_view("application/").size());
    return name == "jwt" || name == "at+jwt";
}

std::optional<Algorithm> algorithmIn(const Json& header) {
    const auto name = header.find("alg");
    if (name == header.end()) return std::nullopt;
    if (*name == "RS256") return Algorithm::Rs256;
    if (*name == "ES256") return Algorithm::Es256;
    if (*name == "EdDSA") return Algorithm::EdDsa;
    return std::nullopt;
}

/// Chooses the key by its id. `jwk`, `jku`, `x5c` and `x5u` in the header choose nothing.
Checked<const Key*> chooseKey(const Json& header, Algorithm algorithm, const IssuerKeys& keys) {
    const auto id = header.find("kid");
    const bool isNamed = id != header.end();
    if (isNamed && !id->is_string()) return Refused(TokenProblem::KeyIdNotText);
    const Key* chosen = nullptr;
    bool isKnown = false;
    for (const Key& key : keys.keys()) {
        if (isNamed && key.id != id->get_ref<const std::string&>()) continue;
        isKnown = true;
        if (key.algorithm != algorithm) continue;
        if (chosen) return Refused(TokenProblem::KeyNotNamed);
        chosen = &key;
    }
    if (!isKnown) return Refused(TokenProblem::UnknownKey);
    if (!chosen) return Refused(TokenProblem::KeyUnfit);
    if (chosen->isShort) return Refused(TokenProblem::KeyTooShort);
    return chosen;
}

Checked<const Key*> keyFor(const Json& header, const IssuerKeys& keys) {
    if (header.contains("crit") || header.contains("b64")) return Refused(TokenProblem::Critical);
    if (!isTypeOfSignIn(header)) return Refused(TokenProblem::OtherType);
    const auto algorithm = algorithmIn(header);
    if (!algorithm) return Refused(TokenProblem::Algorithm);
    return chooseKey(header, *algorithm, keys);
}

// ---- the signature

/// Returns the signature of ES256, two numbers of 32 bytes, as OpenSSL takes it.
std::optional<Bytes> inDer(const Bytes& raw) {
    if (raw.size() != 2 * kHalfSignature) return std::nullopt;
    struct Free {
        void operator()(ECDSA_SIG* signature) const { ECDSA_SIG_free(signature); }
    };
    const std::unique_ptr<ECDSA_SIG, Free> signature(ECDSA_SIG_new());
    BIGNUM* r = BN_bin2bn(raw.data(), int(kHalfSignature), nullptr);
    BIGNUM* s = BN_bin2bn(raw.data() + kHalfSignature, int(kHalfSignature), nullptr);
    if (!signature || !r || !s || ECDSA_SIG_set0(signature.get(), r, s) != 1) {
        BN_free(r);
        BN_free(s);
        throw std::bad_alloc();
    }
    Bytes der(std::size_t(i2d_ECDSA_SIG(signature.get(), nullptr)));
    unsigned char* out = der.data();
    i2d_ECDSA_SIG(signature.get(), &out);
    return der;
}

bool isSignedBy(const Key& key, std::string_view text, std::string_view signature) {
    auto bytes = base64UrlDecoded(signature);
    if (bytes && key.algorithm == Algorithm::Es256) bytes = inDer(*bytes);
    if (!bytes) return false;
    struct Free {
        void operator()(EVP_MD_CTX* context) const { EVP_MD_CTX_free(context); }
    };
    const std::unique_ptr<EVP_MD_CTX, Free> context(EVP_MD_CTX_new());
    if (!context) throw std::bad_alloc();
    const char* digest = key.algorithm == Algorithm::EdDsa ? nullptr : "SHA256";
    const bool isGood =
        EVP_DigestVerifyInit_ex(context.get(), nullptr, digest, nullptr, nullptr, key.key.get(),
                                nullptr) == 1 &&
        EVP_DigestVerify(context.get(), bytes->data(), bytes->size(),
                         reinterpret_cast<const unsigned char*>(text.data()), text.size()) == 1;
    ERR_clear_error();
    return isGood;
}

// ---- the claims

bool isFor(const Json& claims, const std::string& audience) {
    const auto found = claims.find("aud");
    if (found == claims.end()) return false;
    if (found->is_string()) return *found == audience;
    // One entry that is no text makes the list something else than a list of audiences.
    return found->is_array() &&
           std::ranges::all_of(*found, [](const Json& one) { return one.is_string(); }) &&
           std::ranges::find(*found, Json(audience)) != found->end();
}

/// Returns the time of a claim; nothing if there is none.
Checked<std::optional<std::int64_t>> timeIn(const Json& claims, const char* name) {
    const auto found = claims.find(name);
    if (found == claims.end()) return std::nullopt;
    if (!found->is_number_unsigned() || found->get<std::uint64_t>() > std::uint64_t(kLastTime))
        return Refused(TokenProblem::TimeNotValid);
    return found->get<std::int64_t>();
}

Checked<std::int64_t> endOf(const Json& claims, std::int64_t now) {
    const auto end = timeIn(claims, "exp");
    if (!end) return Refused(end.error());
    if (!*end) return Refused(TokenProblem::NoExpiry);
    if (**end <= now) return Refused(TokenProblem::Expired);
    for (const char* name : {"nbf", "iat"}) {
        const auto begin = timeIn(claims, name);
        if (!begin) return Refused(begin.error());
        if (*begin && **begin > now + kClockLeeway) return Refused(TokenProblem::NotYetValid);
    }
    return **end;
}

/// Returns the claim, or nullptr.
const Json* claimIn(const Json& claims, const std::string& name) {
    if (!name.starts_with('/')) {
        const auto found = claims.find(name);
        return found == claims.end() ? nullptr : &*found;
    }
    const Json::json_pointer place(name);
    return claims.contains(place) ? &claims.at(place) : nullptr;
}

Checked<UserName> userIn(const Json& claims, const std::string& name) {
    const Json* user = claimIn(claims, name);
    if (!user || !user->is_string()) return Refused(TokenProblem::NoUser);
    if (!checkUserName(user->get_ref<const std::string&>()))
        return Refused(TokenProblem::UserNotValid);
    if (name == kEmail) {
        const Json* isVerified = claimIn(claims, "email_verified");
        if (!isVerified || *isVerified != true) return Refused(TokenProblem::EmailNotVerified);
    }
    return UserName{user->get<std::string>()};
}

Checked<std::set<std::string>> groupsIn(const Json& claims, const std::string& name) {
    // A rule that takes something from a group would fail if the token does not name all groups.
    if (const Json* elsewhere = claimIn(claims, "_claim_names");
        elsewhere && elsewhere->is_object() && elsewhere->contains(name))
        return Refused(TokenProblem::GroupsLeftOut);
    const Json* found = claimIn(claims, name);
    std::set<std::string> groups;
    if (!found) return groups;
    for (const Json& one : found->is_array() ? *found : Json::array({*found})) {
        if (!one.is_string() || one.get_ref<const std::string&>().size() > kMostGroupBytes)
            return Refused(TokenProblem::GroupsNotValid);
        groups.insert(one.get<std::string>());
    }
    if (groups.size() > kMostGroups) return Refused(TokenProblem::GroupsNotValid);
    return groups;
}

Checked<IssuedIdentity> identityIn(const Json& claims, const IssuerRules& rules, std::int64_t now) {
    const auto issuer = claims.find("iss");
    if (issuer == claims.end() || *issuer != rules.issuer) return Refused(TokenProblem::Issuer);
    if (!isFor(claims, rules.audience)) return Refused(TokenProblem::Audience);
    // An event, such as the end of a sign-in, and no sign-in.
    if (claims.contains("events")) return Refused(TokenProblem::OtherType);
    const auto end = endOf(claims, now);
    if (!end) return Refused(end.error());
    const auto subject = claims.find("sub");
    if (subject == claims.end() || !subject->is_string() ||
        subject->get_ref<const std::string&>().empty() ||
        subject->get_ref<const std::string&>().size() > kMostSubjectBytes)
        return Refused(TokenProblem::NoSubject);
    auto user = userIn(claims, rules.userClaim);
    if (!user) return Refused(user.error());
    auto groups = groupsIn(claims, rules.groupsClaim);
    if (!groups) return Refused(groups.error());
    return IssuedIdentity{std::move(*user), std::move(*groups), *end};
}

}  // namespace

std::string_view describe(TokenProblem problem) {
    constexpr std::array<std::string_view, 28> kSentences{
        "it is longer than 16 KiB",
        "it is not a JWT: three parts with dots between them",
        "a part of it is not base64url",
        "its header or its claims are not JSON in UTF-8",
        "a member is in it twice",
        "its objects are nested too deeply",
        "its header or its claims are not a JSON object",
        "it is for another purpose than signing in",
        "it demands an extension that this server does not have",
        "its algorithm is none of RS256, ES256 and EdDSA",
        "the id of its key is not a text",
        "the issuer has not published the key that it names",
        "it does not say which of the issuer's keys has signed it",
        "the key that it names is for another algorithm or purpose",
        "the key that it names has fewer than 2048 bits",
        "its signature is wrong",
        "it is from another issuer",
        "it is for another audience (--oidc-audience)",
        "it has no time at which it ends",
        "a time in it is not a whole number of seconds",
        "it has expired",
        "it is not valid yet; compare the clocks of this machine and of the issuer",
        "it names no subject",
        "it has no claim with the name of the user (--oidc-user-claim)",
        "the name of the user in it cannot be a user's name here: 1 to 64 letters, digits and "
        "\".-_@\" (--oidc-user-claim)",
        "the issuer does not say that the email is verified (\"email_verified\"); another claim "
        "can "
        "name the user (--oidc-user-claim)",
        "its groups are not a list of at most 1000 texts (--oidc-groups-claim)",
        "the issuer has left out groups, because there are too many of them; let it name those for "
        "this server only",
    };
    static_assert(kSentences.size() == std::size_t(TokenProblem::GroupsLeftOut) + 1);
    return kSentences[std::size_t(problem)];
}

Result<void> checkClaim(std::string_view name) try {
    if (name.empty()) return fail(ErrorCode::InvalidArgument, "a claim has a name");
    if (name.starts_with('/')) (void)Json::json_pointer(std::string(name));
    return {};
} catch (const Json::exception&) {
    return fail(
        ErrorCode::InvalidArgument,
        inQuotes(std::string(name)) + " is not a JSON pointer, such as /realm_access/roles");
}

bool isIssuedToken(std::string_view token) { return std::ranges::count(token, '.') == 2; }

Checked<IssuedIdentity> checkIssuedToken(std::string_view token, const IssuerKeys& keys,
                                         const IssuerRules& rules, std::int64_t now) {
    if (token.size() > kMostTokenBytes) return Refused(TokenProblem::TooLong);
    const auto parts = split(token);
    if (!parts) return Refused(parts.error());
    const auto header = objectIn(parts->header);
    if (!header) return Refused(header.error());
    const auto key = keyFor(*header, keys);
    if (!key) return Refused(key.error());
    if (!isSignedBy(**key, parts->signedText, parts->signature))
        return Refused(TokenProblem::Signature);
    const auto claims = objectIn(parts->claims);
    if (!claims) return Refused(claims.error());
    return identityIn(*claims, rules, now);
}

}  // namespace usdlive::server
