// Checks the names of layers (LN1).
#include "usdlive/common/core/LayerPath.h"

#include <algorithm>
#include <string>

#include "usdlive/common/core/Utf8.h"

namespace usdlive {

namespace {

constexpr std::size_t kMaxLayerPathBytes = 1024;

bool isForbidden(char32_t point) {
    return point < 0x20 || (point >= 0x7F && point < 0xA0) || point == U'\\' || point == U':';
}

const char* problemOfPart(std::string_view part) {
    if (part.empty()) return "has an empty part";
    if (part == "." || part == "..") return "has a part that is '.' or '..'";
    if (part.starts_with(".usdlive")) return "has a part that begins with '.usdlive'";
    return nullptr;
}

char lowerCase(char c) { return c >= 'A' && c <= 'Z' ? char(c - 'A' + 'a') : c; }

bool endsIn(std::string_view file, std::string_view ending) {
    return file.size() > ending.size() &&
           std::ranges::equal(file.substr(file.size() - ending.size()), ending, {}, lowerCase);
}

// OpenUSD recognizes a file's format by its extension, in any case.
bool isUsdFile(std::string_view file) {
    return endsIn(file, ".usd") || endsIn(file, ".usda") || endsIn(file, ".usdc");
}

// Returns the reason why the name is invalid, or nullptr if it is valid.
const char* problemOf(std::string_view text) {
    if (text.empty()) return "is empty";
    if (text.size() > kMaxLayerPathBytes) return "is longer than 1,024 bytes";
    for (std::string_view rest = text; !rest.empty();) {
        const auto point = takeCodePoint(rest);
        if (!point) return "is not UTF-8";
        if (isForbidden(*point)) return "holds a control character, a backslash or a colon";
    }
    if (text.front() == '/') return "is absolute";
    for (std::string_view rest = text;;) {
        const std::size_t slash = rest.find('/');
        const std::string_view part = rest.substr(0, slash);
        if (const char* problem = problemOfPart(part)) return problem;
        if (slash == std::string_view::npos)
            return isUsdFile(part) ? nullptr : "does not end in a name with .usd, .usda or .usdc";
        rest.remove_prefix(slash + 1);
    }
}

}  // namespace

Result<LayerId> parseLayerId(std::string_view text) {
    if (const char* problem = problemOf(text))
        return fail(ErrorCode::InvalidLayerName,
                    "the layer name " + inQuotes(text) + " " + problem);
    return LayerId{std::string(text)};
}

}  // namespace usdlive
