// Which errors pass without any action of the author of an edit.
#pragma once

#include "usdlive/common/core/ErrorCode.h"

namespace usdlive {

/// Returns whether the reason for the error passes without any change to what was refused: the
/// property `passes` in errors.json. What was refused for such a reason is kept, and sent again
/// later (SE8).
[[nodiscard]] bool errorPasses(ErrorCode code);

}  // namespace usdlive
