// Finds asset paths that lead out of the project.
#pragma once

#include <filesystem>
#include <vector>

#include "usdlive/client/session/Events.h"
#include "usdlive/common/usd/ValueCodec.h"

namespace usdlive::client {

/// Returns the paths that the edits write and that nobody else can open: in asset values, in the
/// names of sublayers, references and payloads, and in templates of value clips. These are absolute
/// paths of files in none of `folders`, which are folders of the project; relative paths that leave
/// the project, also those that come back in by the name of its folder, which others do not know;
/// and identifiers of anonymous layers. Addresses of other services are none. Of a variable
/// expression only the text before its first variable counts. Big values are read from `blobs`. At
/// most 1,000 are returned.
[[nodiscard]] std::vector<event::PathOutside> outsidePaths(
    const std::vector<AuthoredEdit>& edits, const std::vector<std::filesystem::path>& folders,
    BlobSource& blobs);

}  // namespace usdlive::client
