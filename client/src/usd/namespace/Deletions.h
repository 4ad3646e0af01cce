// Declares Deletions, which finds out what an edit deletes besides the edited object.
#pragma once

#include <optional>

#include "usd/namespace/Planner.h"
#include "usd/namespace/ScratchStages.h"

namespace usdlive::naming {

/// Finds out which of the objects that Pcp reports as deleted an edit deletes. Whether specs of
/// other arcs keep an object depends on relocates, variants and instances, so it composes copies of
/// the stages with the edit made. It makes the copies for the first plan that needs them.
class Deletions {
public:
    explicit Deletions(const Stages& stages) : stages_(stages) {}

    /// Adds the deleted objects to `plan.objects`. Called for each plan, before its changes are
    /// made in the stages.
    void addDeleted(Plan& plan);

private:
    const Stages& stages_;
    std::optional<ScratchStages> after_;
};

}  // namespace usdlive::naming
