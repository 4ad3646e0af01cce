// Finds the items of a list that can stay in place when the list is sorted.
#pragma once

#include <cstddef>
#include <vector>

namespace usdlive {

inline constexpr std::size_t kNotThere = static_cast<std::size_t>(-1);

/// Marks the numbers of a longest increasing subsequence, so that the fewest others have to move to
/// sort all. kNotThere is never marked. O(n log n).
[[nodiscard]] std::vector<bool> longestIncreasing(const std::vector<std::size_t>& numbers);

}  // namespace usdlive
