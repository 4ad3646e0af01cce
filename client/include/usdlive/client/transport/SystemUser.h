#pragma once

#include "usdlive/common/core/Id.h"

namespace usdlive::client {

/// The name of the person this process runs for, as the system knows it; never empty.
[[nodiscard]] UserName systemUser();

}  // namespace usdlive::client
