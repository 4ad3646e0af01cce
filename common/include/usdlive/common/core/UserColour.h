// The colour of a user.
#pragma once

#include <array>

#include "usdlive/common/core/Id.h"

namespace usdlive {

/// PS3: returns the colour of a user, the same on every client. Red, green and blue from 0 to 1,
/// bright enough to read on dark and on light backgrounds.
[[nodiscard]] std::array<float, 3> userColour(const UserName& user);

}  // namespace usdlive
