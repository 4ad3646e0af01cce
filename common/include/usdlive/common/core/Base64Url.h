// Decodes base64url, as the tokens and keys of OpenID Connect have it.
#pragma once

#include <optional>
#include <string_view>

#include "usdlive/common/core/Bytes.h"

namespace usdlive {

/// Returns nothing for a text with padding, with other characters, or whose last character has bits
/// that no byte takes: one content has one text.
[[nodiscard]] std::optional<Bytes> base64UrlDecoded(std::string_view text);

}  // namespace usdlive
