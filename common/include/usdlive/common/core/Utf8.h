// Checks, splits and quotes UTF-8 text.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace usdlive {

/// Returns true if the text is well-formed UTF-8: no overlong forms, no surrogates, nothing above
/// U+10FFFF.
[[nodiscard]] bool isUtf8(std::string_view text);

/// Removes the first code point from `text` and returns it. Returns nothing and keeps `text` if it
/// is empty or does not begin with a well-formed code point.
[[nodiscard]] std::optional<char32_t> takeCodePoint(std::string_view& text);

/// Quotes foreign text for a message: cut after about 100 bytes, without control characters, always
/// UTF-8.
[[nodiscard]] std::string inQuotes(std::string_view text);

}  // namespace usdlive
