// Finds a longest increasing subsequence by patience sorting.
#include "usdlive/common/layer/LongestIncreasing.h"

#include <algorithm>

namespace usdlive {

std::vector<bool> longestIncreasing(const std::vector<std::size_t>& numbers) {
    std::vector<std::size_t> ends;  // ends[n]: index of the smallest number that ends a run of n+1
    std::vector<std::size_t> previous(numbers.size(), kNotThere);
    for (std::size_t i = 0; i < numbers.size(); ++i) {
        if (numbers[i] == kNotThere) continue;
        const auto at = std::lower_bound(
            ends.begin(), ends.end(), numbers[i],
            [&](std::size_t end, std::size_t number) { return numbers[end] < number; });
        if (at != ends.begin()) previous[i] = *(at - 1);
        if (at == ends.end())
            ends.push_back(i);
        else
            *at = i;
    }
    std::vector<bool> belongs(numbers.size(), false);
    for (std::size_t i = ends.empty() ? kNotThere : ends.back(); i != kNotThere; i = previous[i])
        belongs[i] = true;
    return belongs;
}

}  // namespace usdlive
