#include "usdlive/client/usd/ChildOrder.h"

#include <algorithm>
#include <string_view>
#include <unordered_map>

namespace usdlive::client {

namespace {

// Marks a longest increasing subsequence.
std::vector<bool> increasing(const std::vector<std::size_t>& numbers) {
    constexpr std::size_t kNone = std::size_t(-1);
    std::vector<std::size_t> ends;  // ends[n]: where the best sequence of length n + 1 ends
    std::vector<std::size_t> before(numbers.size(), kNone);
    for (std::size_t i = 0; i < numbers.size(); ++i) {
        const auto at = std::lower_bound(
            ends.begin(), ends.end(), numbers[i],
            [&](std::size_t end, std::size_t number) { return numbers[end] < number; });
        if (at != ends.begin()) before[i] = *(at - 1);
        if (at == ends.end())
            ends.push_back(i);
        else
            *at = i;
    }
    std::vector<bool> marked(numbers.size());
    for (std::size_t i = ends.empty() ? kNone : ends.back(); i != kNone; i = before[i])
        marked[i] = true;
    return marked;
}

}  // namespace

std::vector<std::pair<std::string, std::string>> placements(const std::vector<std::string>& from,
                                                            const std::vector<std::string>& to) {
    std::unordered_map<std::string_view, std::size_t> positions;
    for (std::size_t i = 0; i < from.size(); ++i) positions[from[i]] = i;
    std::vector<std::size_t> numbers;
    for (const auto& name : to) numbers.push_back(positions.at(name));

    // From the back, so that what a name is placed before stands where it belongs already.
    const auto stays = increasing(numbers);
    std::vector<std::pair<std::string, std::string>> moves;
    for (std::size_t i = to.size(); i-- > 0;)
        if (!stays[i]) moves.emplace_back(to[i], i + 1 < to.size() ? to[i + 1] : std::string());
    return moves;
}

}  // namespace usdlive::client
