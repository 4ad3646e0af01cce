// Searches all reachable states of the model.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "Model.h"

namespace usdlive::model {

struct Counterexample {
    std::string rule;
    std::vector<Action> actions;  ///< a shortest way to the violation
};

struct Found {
    std::uint64_t states = 0, transitions = 0, quiet = 0;
    std::size_t depth = 0;
    bool exhausted = false;  ///< there are no other states
    std::optional<Counterexample> counterexample;
};

/// Visits every reachable world, the nearest first, until all are known, a rule is broken, or about
/// `most` were visited. When all are known, it also checks that the steps without a decision always
/// come to an end, in any order.
[[nodiscard]] Found search(Model& model, std::uint64_t most);

}  // namespace usdlive::model
