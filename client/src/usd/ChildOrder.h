#pragma once

#include <string>
#include <utility>
#include <vector>

namespace usdlive::client {

/// The fewest moves that turn the list `from` into `to`, applied one after the other: (name, the
/// name it is placed before; empty: last). Precondition: a permutation without duplicates.
[[nodiscard]] std::vector<std::pair<std::string, std::string>> placements(
    const std::vector<std::string>& from, const std::vector<std::string>& to);

}  // namespace usdlive::client
