// A copy of the locked content of a layer.
#pragma once

#include <pxr/usd/sdf/changeList.h>
#include <pxr/usd/sdf/layer.h>

#include <map>
#include <set>

#include "usd/layers/SpecLockTable.h"

namespace usdlive::layers {

/// The content that one layer must have: its locked specs and everything below locked prims. Also
/// notes what was edited there since takeEdits().
class LockShadow {
public:
    LockShadow(const pxr::SdfLayerHandle& layer, const SpecLockTable& locks);

    /// Takes the present content of the layer, and forgets the edits.
    void take(const pxr::SdfLayerHandle& layer, const SpecLockTable& locks);
    [[nodiscard]] bool has(const pxr::SdfPath& path) const { return content_->HasSpec(path); }
    /// Returns true if the spec at `there` has the content of `path`, including everything below.
    [[nodiscard]] bool isLike(const pxr::SdfLayerHandle& layer, const pxr::SdfPath& there,
                              const pxr::SdfPath& path) const;

    /// Takes the spec as it is in the layer, or is missing there.
    void adopt(const pxr::SdfLayerHandle& layer, const pxr::SdfPath& path);
    /// Gives the spec of the layer its own fields back. Returns true if one of them differed.
    bool restoreFields(const pxr::SdfLayerHandle& layer, const pxr::SdfPath& path) const;
    /// Creates the spec in the layer again, with everything below.
    bool restoreSpec(const pxr::SdfLayerHandle& layer, const pxr::SdfPath& path) const;

    struct Edits {
        std::set<pxr::SdfPath> changed;
        std::set<pxr::SdfPath> applied;                // by the live connection
        std::map<pxr::SdfPath, pxr::SdfPath> renamed;  // from, to
        std::set<pxr::SdfPath> added;                  // added prims, at their present paths
    };
    /// `applied`: the live connection has made the changes.
    void note(const pxr::SdfLayerHandle& layer, const pxr::SdfChangeList& changes, bool applied,
              const SpecLockTable& locks);
    [[nodiscard]] Edits takeEdits();

private:
    pxr::SdfLayerRefPtr content_;
    Edits edits_;
};

}  // namespace usdlive::layers
