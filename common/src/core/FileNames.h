// The rules that names of layers and of other files have in common.
#pragma once

#include <string_view>

namespace usdlive {

/// Returns the reason why the text cannot be a relative path of a project (length, UTF-8, forbidden
/// characters, a slash at the beginning), or nullptr. Does not check its parts.
[[nodiscard]] const char* problemOfText(std::string_view text);

/// Returns true for names that OpenUSD opens as the USD layers that a server serves. OpenUSD
/// recognizes a file's format by its extension, in any case.
[[nodiscard]] bool isLayerName(std::string_view file);

}  // namespace usdlive
