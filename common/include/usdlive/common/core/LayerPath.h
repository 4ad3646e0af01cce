#pragma once

#include <string_view>

#include "usdlive/common/core/Id.h"
#include "usdlive/common/core/Result.h"

namespace usdlive {

/// LN1: a layer's name is a relative path with `/` between its parts, in UTF-8, at most 1,024
/// bytes, no part of it empty, `.` or `..`, no part beginning with `.usdlive`, no NUL, control
/// character, backslash or colon, and its last part ends in `.usd`, `.usda` or `.usdc`, in any
/// case, after something. Says what is wrong otherwise (ErrorCode::InvalidLayerName). Whether a
/// link on the disk leads out is for server/files to say.
[[nodiscard]] Result<LayerId> parseLayerId(std::string_view text);

}  // namespace usdlive
