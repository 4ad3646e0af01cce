// Checks identifiers as OpenUSD does.
#pragma once

#include <string_view>

namespace usdlive {

/// PA1: returns true for names that OpenUSD accepts, so that no replica fails on a spec that the
/// server accepted.
[[nodiscard]] bool isIdentifier(std::string_view text);
/// Returns true for identifiers separated by `:`.
[[nodiscard]] bool isPropertyName(std::string_view text);
/// Returns true for a non-empty text of characters that can follow the first in an identifier, `|`
/// and `-`, with an optional leading `.`.
[[nodiscard]] bool isVariantName(std::string_view text);

}  // namespace usdlive
