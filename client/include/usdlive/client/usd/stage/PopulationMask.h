#pragma once

#include <pxr/usd/sdf/path.h>

#include <optional>
#include <set>

namespace usdlive::stage {

/// The part of a stage that is composed: prims of these paths, all below them, and the prims above.
class PopulationMask {
public:
    /// Everything.
    PopulationMask() = default;
    explicit PopulationMask(const pxr::SdfPathVector& paths);

    [[nodiscard]] bool isAll() const { return !paths_; }
    /// None of them is above another.
    [[nodiscard]] pxr::SdfPathVector paths() const;
    [[nodiscard]] bool includes(const pxr::SdfPath& prim) const;
    [[nodiscard]] bool includesSubtree(const pxr::SdfPath& prim) const;
    /// Whether any child of `prim` is included. `names` is filled when only some are.
    [[nodiscard]] bool includedChildren(const pxr::SdfPath& prim, pxr::TfTokenVector* names) const;
    /// The mask below `prim`, as if it were the root: two instances with equal ones show the same.
    [[nodiscard]] PopulationMask below(const pxr::SdfPath& prim) const;

    bool operator==(const PopulationMask&) const = default;

private:
    std::optional<std::set<pxr::SdfPath>> paths_;  // none is above another
};

}  // namespace usdlive::stage
