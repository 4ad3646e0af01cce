#pragma once

#include <pxr/usd/sdf/path.h>

#include <map>
#include <set>

namespace usdlive::stage {

/// What one round of changes did to a stage, in paths of the stage. Paths of different sets never
/// contain each other.
struct StageChanges {
    using Fields = std::set<pxr::TfToken>;

    /// Prims whose subtrees were composed again, and properties that came, went, or changed type.
    std::set<pxr::SdfPath> resynced;
    /// Prims and properties of which only fields changed: values, targets, metadata.
    std::map<pxr::SdfPath, Fields> changedInfo;
    /// Prims below which asset paths may resolve to other files.
    std::set<pxr::SdfPath> assetPathsResynced;

    [[nodiscard]] bool isEmpty() const {
        return resynced.empty() && changedInfo.empty() && assetPathsResynced.empty();
    }
};

}  // namespace usdlive::stage
