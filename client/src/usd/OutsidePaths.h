// Finds asset paths that lead out of the project.
#pragma once

#include <filesystem>
#include <vector>

#include "usdlive/client/session/Events.h"

namespace usdlive::client {

/// Returns the absolute file paths that the edits write and that are in none of `folders`, which
/// are folders of the project: in asset values, and in the names of sublayers, references and
/// payloads. Others do not have these files. Reads the values only of edits that may hold one; at
/// most 1,000 are returned.
[[nodiscard]] std::vector<event::PathOutside> outsidePaths(
    const std::vector<AuthoredEdit>& edits, const std::vector<std::filesystem::path>& folders);

}  // namespace usdlive::client
