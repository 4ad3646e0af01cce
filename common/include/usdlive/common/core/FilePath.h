// Checks the names of files that are no layers.
#pragma once

#include <string_view>

#include "usdlive/common/core/Result.h"

namespace usdlive {

/// FI7: checks the name of a file that a client uploads. A name is a relative path as for layers
/// (LN1), but no part of it begins with a dot, because hidden files are not served, and it does not
/// end as a layer does. Returns ErrorCode::InvalidFileName with the reason, and what to do.
/// server/files checks that no link on the disk leads out of the project.
[[nodiscard]] Result<void> checkFilePath(std::string_view text);

}  // namespace usdlive
