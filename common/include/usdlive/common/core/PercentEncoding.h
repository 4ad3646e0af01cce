// Encodes and decodes percent-encoded text of URLs.
#pragma once

#include <optional>
#include <string>
#include <string_view>

namespace usdlive {

/// Decodes percent-encoded characters. Returns nothing if a % is not followed by two hexadecimal
/// digits.
[[nodiscard]] std::optional<std::string> percentDecoded(std::string_view text);

/// Encodes the characters that the path of a URL cannot contain: spaces, control characters, %, ?
/// and #. Slashes and all other characters are kept.
[[nodiscard]] std::string percentEncoded(std::string_view text);

/// Encodes the characters for which `isEncoded` returns true, with upper-case digits. That has to
/// be so for %, or the text cannot be decoded again.
[[nodiscard]] std::string percentEncodedIf(std::string_view text, bool (*isEncoded)(char));

}  // namespace usdlive
