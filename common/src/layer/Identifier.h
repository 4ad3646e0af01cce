#pragma once

#include <string_view>

namespace usdlive {

/// The names of PA1, as OpenUSD takes them, so that no replica fails at a spec the server accepted.
[[nodiscard]] bool isIdentifier(std::string_view text);
/// Identifiers with `:` between them.
[[nodiscard]] bool isPropertyName(std::string_view text);
/// What an identifier may go on with, `|` and `-` in any order, after a `.` or not; not empty.
[[nodiscard]] bool isVariantName(std::string_view text);

}  // namespace usdlive
