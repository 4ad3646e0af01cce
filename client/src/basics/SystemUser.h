// The name of the user that runs this process.
#pragma once

#include "usdlive/common/core/Id.h"

namespace usdlive::client {

/// Returns the name of the user that runs this process. Never empty.
[[nodiscard]] UserName systemUser();

}  // namespace usdlive::client
