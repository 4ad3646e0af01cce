// Declares LoadRules, which select the payloads that a stage loads.
#pragma once

#include <pxr/usd/sdf/path.h>

#include <map>

namespace usdlive::stage {

/// Selects the payloads that a stage loads. Corresponds to UsdStageLoadRules. The rule of the
/// nearest prim at or above a path applies; without a rule, all payloads are loaded. A value type.
class LoadRules {
public:
    enum class Rule {
        All,   ///< loads this payload and all payloads below
        Only,  ///< loads this payload, and no payload below
        None,  ///< loads no payload, here or below
    };

    [[nodiscard]] static LoadRules all() { return {}; }
    [[nodiscard]] static LoadRules none();

    /// Sets the rule of a prim and removes the rules of the prims below it. Paths that are not
    /// paths of prims, or have more than 512 elements, are ignored.
    void set(const pxr::SdfPath& prim, Rule rule);

    /// Returns the effective rule of a prim. If a payload is loaded, the payloads above it are
    /// loaded as well.
    [[nodiscard]] Rule ruleOf(const pxr::SdfPath& prim) const;
    [[nodiscard]] bool isLoaded(const pxr::SdfPath& prim) const {
        return ruleOf(prim) != Rule::None;
    }
    /// Returns the rules at and below `prim`, relative to it as the root. Two instances with equal
    /// rules load the same payloads.
    [[nodiscard]] LoadRules below(const pxr::SdfPath& prim) const;

    /// Returns the rule of each path that has one of its own.
    [[nodiscard]] const std::map<pxr::SdfPath, Rule>& rules() const { return rules_; }

    bool operator==(const LoadRules&) const = default;

private:
    std::map<pxr::SdfPath, Rule> rules_;  // a path without a rule at or above it uses All
};

}  // namespace usdlive::stage
