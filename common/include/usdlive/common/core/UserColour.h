#pragma once

#include <array>

#include "usdlive/common/core/Id.h"

namespace usdlive {

/// PS3: the colour by which a user is shown, the same everywhere: red, green and blue from 0 to 1,
/// bright enough to read on dark and on light.
[[nodiscard]] std::array<float, 3> userColour(const UserName& user);

}  // namespace usdlive
