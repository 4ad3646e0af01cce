// The id of a client and the secret that proves it.
#pragma once

#include "usdlive/common/core/Hash.h"
#include "usdlive/common/core/Id.h"

namespace usdlive {

/// Returns 32 bytes from the system's random source, which only a client and its servers know.
[[nodiscard]] Hash newClientSecret();
/// ID5: returns the id that this secret proves: `k` and the first 31 hexadecimal digits of the
/// SHA-256 of its bytes.
[[nodiscard]] ClientId clientIdOf(const Hash& secret);
/// Returns whether an id has the form of those of clientIdOf(), so that its client has to prove it.
[[nodiscard]] bool needsSecret(const ClientId& id);

}  // namespace usdlive
