// Parses the names of layers.
#pragma once

#include <string_view>

#include "usdlive/common/core/Id.h"
#include "usdlive/common/core/Result.h"

namespace usdlive {

/// LN1: parses the name of a layer. A name is a relative path in UTF-8 with `/` between its parts
/// and at most 1,024 bytes. No part is empty, `.` or `..`, or begins with `.usdlive`. NUL, control
/// characters, backslashes and colons are forbidden. The last part has a stem and ends in `.usd`,
/// `.usda` or `.usdc`, in any case.
/// Returns ErrorCode::InvalidLayerName with the reason for any other text. server/files checks that
/// no link on the disk leads out of the project.
[[nodiscard]] Result<LayerId> parseLayerId(std::string_view text);

}  // namespace usdlive
