// Declares PopulationMask, which selects the part of a stage that is composed.
#pragma once

#include <pxr/usd/sdf/path.h>

#include <optional>
#include <set>

namespace usdlive::stage {

/// Selects the prims that a stage composes: the listed prims, the prims below them and the prims
/// above them. A value type.
class PopulationMask {
public:
    /// Selects all prims.
    PopulationMask() = default;
    /// Selects `paths`. Paths that are not paths of prims, or have more than 512
    /// elements, are ignored.
    explicit PopulationMask(const pxr::SdfPathVector& paths);

    [[nodiscard]] bool isAll() const { return !paths_; }
    /// Returns the paths of the mask, sorted. No path is above another one. Returns the root if all
    /// prims are selected, so that `PopulationMask(mask.paths())` selects what `mask` selects.
    [[nodiscard]] pxr::SdfPathVector paths() const;
    [[nodiscard]] bool includes(const pxr::SdfPath& prim) const;
    [[nodiscard]] bool includesSubtree(const pxr::SdfPath& prim) const;
    /// Returns true if a child of `prim` is included. If only some children are included, adds
    /// their names to `names`.
    [[nodiscard]] bool includedChildren(const pxr::SdfPath& prim, pxr::TfTokenVector* names) const;
    /// Returns the mask below `prim`, relative to it as the root. Two instances with equal masks
    /// show the same prims.
    [[nodiscard]] PopulationMask below(const pxr::SdfPath& prim) const;

    bool operator==(const PopulationMask&) const = default;

private:
    std::optional<std::set<pxr::SdfPath>> paths_;  // no path contains another one
};

}  // namespace usdlive::stage
