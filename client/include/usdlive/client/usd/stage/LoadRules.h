#pragma once

#include <pxr/usd/sdf/path.h>

#include <map>

namespace usdlive::stage {

/// Which payloads a stage loads. The rule of the nearest prim at or above a path decides.
class LoadRules {
public:
    enum class Rule {
        All,   ///< this payload and all below
        Only,  ///< this payload, and none below
        None,  ///< neither
    };

    [[nodiscard]] static LoadRules all() { return {}; }
    [[nodiscard]] static LoadRules none();

    /// Sets the rule of a prim and drops the rules of the prims below.
    void set(const pxr::SdfPath& prim, Rule rule);

    /// A payload above one that is loaded is loaded too.
    [[nodiscard]] Rule ruleOf(const pxr::SdfPath& prim) const;
    [[nodiscard]] bool isLoaded(const pxr::SdfPath& prim) const {
        return ruleOf(prim) != Rule::None;
    }
    /// The rules at and below `prim`, as if it were the root: two instances with equal ones load
    /// alike.
    [[nodiscard]] LoadRules below(const pxr::SdfPath& prim) const;

    [[nodiscard]] const std::map<pxr::SdfPath, Rule>& rules() const { return rules_; }

    bool operator==(const LoadRules&) const = default;

private:
    void dropNeedless();

    std::map<pxr::SdfPath, Rule> rules_;  // no rule at or above a path: All
};

}  // namespace usdlive::stage
