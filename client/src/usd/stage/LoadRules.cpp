// Selects the payloads that a stage loads, by the nearest rule at or above each path.
#include "usdlive/client/usd/stage/LoadRules.h"

#include <iterator>

#include "usd/stage/DepthGuard.h"

namespace usdlive::stage {

using pxr::SdfPath;

namespace {

// Removes the rules that are equal to the nearest rule above them.
void dropNeedless(std::map<SdfPath, LoadRules::Rule>& rules) {
    for (auto at = rules.begin(); at != rules.end();) {
        auto above = rules.end();
        for (SdfPath up = at->first.GetParentPath(); above == rules.end() && !up.IsEmpty();
             up = up.GetParentPath())
            above = rules.find(up);
        const auto inherited = above == rules.end() ? LoadRules::Rule::All : above->second;
        at = at->second == inherited ? rules.erase(at) : std::next(at);
    }
}

}  // namespace

LoadRules LoadRules::none() {
    LoadRules rules;
    rules.set(SdfPath::AbsoluteRootPath(), Rule::None);
    return rules;
}

void LoadRules::set(const SdfPath& prim, Rule rule) {
    if (!canBePrim(prim)) return;
    auto at = rules_.lower_bound(prim);
    while (at != rules_.end() && at->first.HasPrefix(prim)) at = rules_.erase(at);
    rules_[prim] = rule;
}

LoadRules::Rule LoadRules::ruleOf(const SdfPath& prim) const {
    if (rules_.empty()) return Rule::All;
    auto nearest = rules_.end();
    for (SdfPath at = prim; nearest == rules_.end() && !at.IsEmpty(); at = at.GetParentPath())
        nearest = rules_.find(at);
    if (nearest == rules_.end() || nearest->second == Rule::All) return Rule::All;
    if (nearest->second == Rule::Only && nearest->first == prim) return Rule::Only;
    for (auto at = rules_.upper_bound(prim); at != rules_.end() && at->first.HasPrefix(prim); ++at)
        if (at->second != Rule::None) return Rule::Only;
    return Rule::None;
}

LoadRules LoadRules::below(const SdfPath& prim) const {
    LoadRules rules;
    const auto& root = SdfPath::AbsoluteRootPath();
    rules.rules_.emplace(root, ruleOf(prim));
    for (auto at = rules_.upper_bound(prim); at != rules_.end() && at->first.HasPrefix(prim); ++at)
        rules.rules_.emplace(at->first.ReplacePrefix(prim, root), at->second);
    dropNeedless(rules.rules_);
    return rules;
}

}  // namespace usdlive::stage
