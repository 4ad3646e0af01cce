// Computes the moves between two orders of a list.
#include "basics/Placements.h"

#include <string_view>
#include <unordered_map>

#include "usdlive/common/layer/LongestIncreasing.h"

namespace usdlive::client {

std::vector<std::pair<std::string, std::string>> placements(const std::vector<std::string>& from,
                                                            const std::vector<std::string>& to) {
    std::unordered_map<std::string_view, std::size_t> positions;
    for (std::size_t i = 0; i < from.size(); ++i) positions[from[i]] = i;
    std::vector<std::size_t> numbers;
    for (const auto& name : to) numbers.push_back(positions.at(name));

    // Starts at the end, so that the name before which another one is placed is already in its
    // place.
    const auto stays = longestIncreasing(numbers);
    std::vector<std::pair<std::string, std::string>> moves;
    for (std::size_t i = to.size(); i-- > 0;)
        if (!stays[i]) moves.emplace_back(to[i], i + 1 < to.size() ? to[i + 1] : std::string());
    return moves;
}

}  // namespace usdlive::client
