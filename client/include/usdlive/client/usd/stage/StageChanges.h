// Declares StageChanges, the value that Stage sends to its subscribers after each change.
#pragma once

#include <pxr/usd/sdf/path.h>

#include <map>
#include <set>

namespace usdlive::stage {

/// The effects of one update of a stage. All paths are paths of the stage. A path in one set never
/// contains a path in another set.
struct StageChanges {
    using Fields = std::set<pxr::TfToken>;

    /// Prims whose subtrees were composed again, and properties that were added, removed or changed
    /// their type.
    std::set<pxr::SdfPath> resynced;
    /// Prims and properties of which only fields changed (values, targets, metadata), with the
    /// names of these fields.
    std::map<pxr::SdfPath, Fields> changedInfo;
    /// Prims below which asset paths may now resolve to other files.
    std::set<pxr::SdfPath> assetPathsResynced;

    [[nodiscard]] bool isEmpty() const {
        return resynced.empty() && changedInfo.empty() && assetPathsResynced.empty();
    }
};

}  // namespace usdlive::stage
