// The moves between two orders of a list.
#pragma once

#include <string>
#include <utility>
#include <vector>

namespace usdlive::client {

/// Returns the least number of moves that turn the list `from` into `to`, in order: (name, the name
/// before which it is placed; empty: at the end). Precondition: `to` is a permutation of `from`
/// without duplicates.
[[nodiscard]] std::vector<std::pair<std::string, std::string>> placements(
    const std::vector<std::string>& from, const std::vector<std::string>& to);

}  // namespace usdlive::client
