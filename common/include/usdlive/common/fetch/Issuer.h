// The addresses that an OpenID Connect issuer publishes.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "usdlive/common/fetch/Http.h"
#include "usdlive/common/fetch/ServiceUrl.h"

namespace usdlive::fetch {

/// An issuer, as its discovery document describes it.
struct Issuer {
    ServiceUrl keys;                    ///< its JWK Set
    ServiceUrl tokens;                  ///< gives tokens
    std::string tokensUrl;              ///< the same as text
    std::optional<ServiceUrl> devices;  ///< begins a sign-in with another device (RFC 8628)
    std::vector<std::string> scopes;    ///< that it names; may be empty
};

/// The limits for requests to an issuer: 5 s, 256 KiB.
[[nodiscard]] HttpLimits issuerLimits();

/// Reads `URL/.well-known/openid-configuration`. The document has to name this URL as its issuer,
/// character by character, and only encrypted addresses, except on this machine. Blocks for at most
/// 5 s; ends soon after `isStopped`, which may be empty, returns true. Any thread.
[[nodiscard]] Fetched<Issuer> discover(const std::string& url,
                                       const std::function<bool()>& isStopped = {});

}  // namespace usdlive::fetch
