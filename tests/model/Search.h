#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "Model.h"

namespace usdlive::model {

struct Counterexample {
    std::string rule;
    std::vector<Action> actions;  ///< no fewer lead to it
};

struct Found {
    std::uint64_t states = 0, transitions = 0, quiet = 0;
    std::size_t depth = 0;
    bool exhausted = false;  ///< there are no other states
    std::optional<Counterexample> counterexample;
};

/// Visits every world that can be reached, the nearest first, until all are known, a rule does not
/// hold, or there are about `most`. When all are known it is also checked that whatever goes on by
/// itself comes to an end, in whichever order it happens.
[[nodiscard]] Found search(Model& model, std::uint64_t most);

}  // namespace usdlive::model
