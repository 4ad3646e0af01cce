// Checks the names of files that are no layers (FI7).
#include "usdlive/common/core/FilePath.h"

#include <string>

#include "FileNames.h"
#include "usdlive/common/core/Utf8.h"

namespace usdlive {

namespace {

const char* problemOfFile(std::string_view text) {
    if (const char* problem = problemOfText(text)) return problem;
    for (std::string_view rest = text;;) {
        const std::size_t slash = rest.find('/');
        const std::string_view part = rest.substr(0, slash);
        const bool isLast = slash == std::string_view::npos;
        if (part.empty())
            return isLast ? "names a folder: add the file's name" : "has an empty part";
        if (part == "." || part == "..")
            return "has a part that is '.' or '..': name the file by its path in the project";
        if (part.starts_with('.'))
            return "has a part that begins with a dot: hidden files are not served. Choose another "
                   "name";
        if (isLast)
            return isLayerName(part)
                       ? "is that of a layer, which is edited and not uploaded: create "
                         "it as a layer (create_layer), or put the file into the "
                         "folder that the server serves"
                       : nullptr;
        rest.remove_prefix(slash + 1);
    }
}

}  // namespace

Result<void> checkFilePath(std::string_view text) {
    if (const char* problem = problemOfFile(text))
        return fail(ErrorCode::InvalidFileName, "the file name " + inQuotes(text) + " " + problem);
    return {};
}

}  // namespace usdlive
