// Requests for a project's files (AS1-AS4).
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "usdlive/common/core/Hash.h"
#include "usdlive/common/core/Id.h"
#include "usdlive/common/core/Result.h"

namespace usdlive::server {

struct FileRequest {
    std::string path;                            ///< empty: the list of all files
    std::optional<Hash> hash = {};               ///< the file has to have this content
    std::optional<Revision> revision = {};       ///< layers as they were at this revision
    std::optional<std::string> checkpoint = {};  ///< or at this checkpoint
    bool layers = true;                          ///< the list has layers, too
    bool operator==(const FileRequest&) const = default;
};

/// Parses what follows `/files` in the path of a URL, and its query. Both are percent-encoded.
/// Error: InvalidArgument, if the path cannot be that of a file in a project (AS2) or a part of the
/// query is malformed. Unknown parts of the query are ignored.
[[nodiscard]] Result<FileRequest> parseFileRequest(std::string_view path, std::string_view query);

/// AS2: returns true for a relative path, in UTF-8 and of at most 4,096 bytes, none of whose parts
/// is empty or begins with a dot.
[[nodiscard]] bool isFilePath(std::string_view path);

}  // namespace usdlive::server
