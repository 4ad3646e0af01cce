#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace usdlive {

/// Is the text well-formed UTF-8: no overlong forms, no surrogates, nothing above U+10FFFF?
[[nodiscard]] bool isUtf8(std::string_view text);

/// Takes the first code point off `text`; nothing when `text` is empty or does not begin with a
/// well-formed one (`text` is then left as it is).
[[nodiscard]] std::optional<char32_t> takeCodePoint(std::string_view& text);

/// Foreign text as a message may show it: in quotes, cut at some 100 bytes, without control
/// characters, always UTF-8.
[[nodiscard]] std::string inQuotes(std::string_view text);

}  // namespace usdlive
