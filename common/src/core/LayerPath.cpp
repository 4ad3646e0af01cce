// Checks the names of layers (LN1).
#include "usdlive/common/core/LayerPath.h"

#include <string>

#include "FileNames.h"
#include "usdlive/common/core/Utf8.h"

namespace usdlive {

namespace {

const char* problemOfPart(std::string_view part) {
    if (part.empty()) return "has an empty part";
    if (part == "." || part == "..") return "has a part that is '.' or '..'";
    if (part.starts_with(".usdlive")) return "has a part that begins with '.usdlive'";
    return nullptr;
}

// Returns the reason why the name is invalid, or nullptr if it is valid.
const char* problemOf(std::string_view text) {
    if (const char* problem = problemOfText(text)) return problem;
    for (std::string_view rest = text;;) {
        const std::size_t slash = rest.find('/');
        const std::string_view part = rest.substr(0, slash);
        if (const char* problem = problemOfPart(part)) return problem;
        if (slash == std::string_view::npos)
            return isLayerName(part) ? nullptr : "does not end in a name with .usd, .usda or .usdc";
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
