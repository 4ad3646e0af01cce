#include "usdlive/client/usd/stage/LoadRules.h"

#include <iterator>

namespace usdlive::stage {

using pxr::SdfPath;

LoadRules LoadRules::none() {
    LoadRules rules;
    rules.set(SdfPath::AbsoluteRootPath(), Rule::None);
    return rules;
}

void LoadRules::set(const SdfPath& prim, Rule rule) {
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
    rules.dropNeedless();
    return rules;
}

// Those that say what the nearest one above says.
void LoadRules::dropNeedless() {
    for (auto at = rules_.begin(); at != rules_.end();) {
        auto above = rules_.end();
        for (SdfPath up = at->first.GetParentPath(); above == rules_.end() && !up.IsEmpty();
             up = up.GetParentPath())
            above = rules_.find(up);
        const Rule inherited = above == rules_.end() ? Rule::All : above->second;
        at = at->second == inherited ? rules_.erase(at) : std::next(at);
    }
}

}  // namespace usdlive::stage
