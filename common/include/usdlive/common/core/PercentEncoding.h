#pragma once

#include <optional>
#include <string>
#include <string_view>

namespace usdlive {

/// Decodes percent-encoded characters. Nothing if a % is not followed by two hexadecimal digits.
[[nodiscard]] std::optional<std::string> percentDecoded(std::string_view text);

/// Encodes what cannot stand in the path of a URL: spaces, control characters, %, ? and #. Slashes
/// and all other characters stay as they are.
[[nodiscard]] std::string percentEncoded(std::string_view text);

}  // namespace usdlive
