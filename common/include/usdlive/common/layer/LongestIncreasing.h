#pragma once

#include <cstddef>
#include <vector>

namespace usdlive {

inline constexpr std::size_t kNotThere = static_cast<std::size_t>(-1);

/// Which of the numbers belong to a longest increasing run (not of neighbours), so that the fewest
/// have to move to get all into order. kNotThere never belongs to it. O(n log n).
[[nodiscard]] std::vector<bool> longestIncreasing(const std::vector<std::size_t>& numbers);

}  // namespace usdlive
