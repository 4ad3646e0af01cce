#pragma once

#include <pxr/usd/sdf/changeList.h>
#include <pxr/usd/sdf/layer.h>

#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "usdlive/client/usd/layers/LayersContext.h"
#include "usdlive/common/core/Id.h"

namespace usdlive::layers {

/// Specs that take no edits. Kept in the root layer's customLayerData, `omni_layer:specs_locking`
/// {spec path: who locked it}, so that locks are shared live and survive. A flat set of exact
/// paths.
///
/// An edit of a locked spec in any layer of the stack goes back with update(), to what the layer
/// said when the lock came. A locked prim takes no new properties, and no new children where all
/// children that it has are locked. What a live connection brings is what the project has, and
/// stays.
class SpecsLocking {
public:
    using Paths = std::vector<pxr::SdfPath>;

    SpecsLocking(LayersContext& context, UserName user);
    ~SpecsLocking();

    /// Returns the specs that were not locked before.
    LayerResult<Paths> lockSpec(const pxr::SdfPath& path, bool hierarchy);

    struct Unlocked {
        Paths specs;
        /// Why not all was unlocked. In a live project a lock of somebody else stays, and this
        /// names its holder.
        std::optional<LayerError> refused;
    };
    /// Specs that are not in the stage can be unlocked, too.
    Unlocked unlockSpec(const pxr::SdfPath& path, bool hierarchy);
    Unlocked unlockAllSpecs();
    [[nodiscard]] Paths allLockedSpecs() const;
    [[nodiscard]] bool isSpecLocked(const pxr::SdfPath& path) const;

    /// Why the spec takes no edits; nothing: it does.
    [[nodiscard]] std::optional<LayerError> whyLocked(const pxr::SdfPath& spec) const;

    // --- called by Layers

    void dataChanged();
    void layerChanged(const pxr::SdfLayerHandle& layer, const pxr::SdfChangeList& changes);
    /// The stack has other layers than before.
    void structureChanged();
    /// Takes back what must not be, within the caller's change block. The delegate is not touched.
    [[nodiscard]] std::vector<RefusedEdit> update(const pxr::SdfLayerHandle& delegate);

private:
    using Table = std::map<pxr::SdfPath, UserName>;
    struct Shadow {
        pxr::SdfLayerRefPtr content;  // what locked specs, and all below locked prims, should be
        std::set<pxr::SdfPath> changed;
        std::set<pxr::SdfPath> applied;                // by the live connection
        std::map<pxr::SdfPath, pxr::SdfPath> renamed;  // from, to
        std::set<pxr::SdfPath> added;                  // prims, wherever they stand
    };

    [[nodiscard]] Table all() const;
    [[nodiscard]] bool isForeign(const UserName& owner) const;
    template <class Chosen>
    Unlocked unlock(Chosen chosen);
    /// The prim or property at or above `path` that a locked prim did not have when it was locked.
    [[nodiscard]] std::optional<pxr::SdfPath> additionAt(const pxr::SdfPath& path) const;
    [[nodiscard]] bool hadSpec(const pxr::SdfPath& path) const;
    [[nodiscard]] bool takesChildren(const pxr::SdfPath& prim) const;
    LayerResult<Paths> change(Table changed);
    void follow(Table locks);
    void admit();
    void settleAll();
    void takeShadows();
    [[nodiscard]] bool covers(const pxr::SdfPath& path) const;
    [[nodiscard]] bool hasLockBelow(const pxr::SdfPath& path) const;
    void takeShadow(const pxr::SdfLayerHandle& layer, Shadow& shadow);
    void refuse(const pxr::SdfLayerHandle& layer, const pxr::SdfPath& path);
    void settleLayer(const pxr::SdfLayerHandle& layer, Shadow& shadow);
    void removeAdditions(const pxr::SdfLayerHandle& layer, const std::set<pxr::SdfPath>& changed);
    bool moveBack(const pxr::SdfLayerHandle& layer, Shadow& shadow, const pxr::SdfPath& path);
    static void adopt(const pxr::SdfLayerHandle& layer, Shadow& shadow, const pxr::SdfPath& path);
    void settleMissing(const pxr::SdfLayerHandle& layer, Shadow& shadow, const pxr::SdfPath& path);
    void settle(const pxr::SdfLayerHandle& layer, Shadow& shadow, const pxr::SdfPath& path);
    void restore(const pxr::SdfLayerHandle& layer, const Shadow& shadow, const pxr::SdfPath& path);
    void restoreBelow(const pxr::SdfLayerHandle& layer, const Shadow& shadow,
                      const pxr::SdfPath& path);
    void removeStray(const pxr::SdfLayerHandle& layer, const pxr::SdfPath& path);

    LayersContext& context_;
    const UserName user_;
    Table locks_;
    Table incoming_;  // in force when what was written before them is settled
    std::map<std::string, Shadow> shadows_;  // by the layer's identifier
    // Answers of takesChildren() since the last update().
    mutable std::map<pxr::SdfPath, bool> takesChildren_;
    std::set<pxr::SdfPath> released_;  // properties that were unlocked under a prim that is locked
    bool structureKnown_ = false;
    bool changing_ = false;
    pxr::SdfLayerHandle delegate_;
    std::vector<RefusedEdit> refused_;
};

}  // namespace usdlive::layers
