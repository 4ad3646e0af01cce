// Checks what names of layers and of other files have in common.
#include "FileNames.h"

#include <algorithm>
#include <cstddef>

#include "usdlive/common/core/Utf8.h"

namespace usdlive {

namespace {

constexpr std::size_t kMaxFilePathBytes = 1024;

bool isForbidden(char32_t point) {
    return point < 0x20 || (point >= 0x7F && point < 0xA0) || point == U'\\' || point == U':';
}

char lowerCase(char c) { return c >= 'A' && c <= 'Z' ? char(c - 'A' + 'a') : c; }

bool endsIn(std::string_view file, std::string_view ending) {
    return file.size() > ending.size() &&
           std::ranges::equal(file.substr(file.size() - ending.size()), ending, {}, lowerCase);
}

}  // namespace

const char* problemOfText(std::string_view text) {
    if (text.empty()) return "is empty";
    if (text.size() > kMaxFilePathBytes) return "is longer than 1,024 bytes";
    for (std::string_view rest = text; !rest.empty();) {
        const auto point = takeCodePoint(rest);
        if (!point) return "is not UTF-8";
        if (isForbidden(*point)) return "holds a control character, a backslash or a colon";
    }
    return text.front() == '/' ? "is absolute" : nullptr;
}

bool isLayerName(std::string_view file) {
    return endsIn(file, ".usd") || endsIn(file, ".usda") || endsIn(file, ".usdc");
}

}  // namespace usdlive
