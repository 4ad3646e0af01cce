// Locks of specs.
#pragma once

#include <pxr/usd/sdf/changeList.h>
#include <pxr/usd/sdf/layer.h>

#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "usdlive/client/usd/layers/LayerTypes.h"
#include "usdlive/common/core/Id.h"

namespace usdlive::layers {

struct LayersContext;

/// The specs that accept no edits. Kept in the root layer's customLayerData,
/// `omni_layer:specs_locking` {spec path: user who locked it}, so that locks are shared live and
/// saved. A flat set of exact paths.
///
/// update() takes back edits of locked specs in any layer of the stack, to the content at the time
/// of the lock. A locked prim accepts no new properties, and no new children if all its existing
/// children are locked. Edits from a live connection are part of the project and stay.
class SpecsLocking {
public:
    using Paths = std::vector<pxr::SdfPath>;

    SpecsLocking(LayersContext& context, UserName user);
    ~SpecsLocking();

    /// Returns the specs that were not locked before.
    LayerResult<Paths> lockSpec(const pxr::SdfPath& path, bool hierarchy);

    struct Unlocked {
        Paths specs;
        /// The reason if not all specs were unlocked. In a live project the locks of others stay,
        /// and this names their holder.
        std::optional<LayerError> refused;
    };
    /// Can also unlock specs that are not on the stage; a path without spec and lock is refused.
    Unlocked unlockSpec(const pxr::SdfPath& path, bool hierarchy);
    Unlocked unlockAllSpecs();
    [[nodiscard]] Paths allLockedSpecs() const;
    [[nodiscard]] bool isSpecLocked(const pxr::SdfPath& path) const;

    /// Returns the reason why the spec accepts no edits, or nothing if it does.
    [[nodiscard]] std::optional<LayerError> whyLocked(const pxr::SdfPath& spec) const;

    // --- called by Layers

    void dataChanged();
    void layerChanged(const pxr::SdfLayerHandle& layer, const pxr::SdfChangeList& changes);
    /// Call when the layers of the stack have changed.
    void structureChanged();
    /// Takes back forbidden edits, within the caller's change block. Does not change the delegate.
    [[nodiscard]] std::vector<RefusedEdit> update(const pxr::SdfLayerHandle& delegate);

private:
    using Table = std::map<pxr::SdfPath, UserName>;
    struct Shadow {
        // The required content of locked specs and of everything below locked prims.
        pxr::SdfLayerRefPtr content;
        std::set<pxr::SdfPath> changed;
        std::set<pxr::SdfPath> applied;                // by the live connection
        std::map<pxr::SdfPath, pxr::SdfPath> renamed;  // from, to
        std::set<pxr::SdfPath> added;                  // added prims, at their present paths
    };

    [[nodiscard]] Table all() const;
    [[nodiscard]] bool isForeign(const UserName& owner) const;
    template <class Chosen>
    Unlocked unlock(Chosen chosen);
    /// Returns the prim or property at or above `path` that a locked prim did not have when it was
    /// locked.
    [[nodiscard]] std::optional<pxr::SdfPath> additionAt(const pxr::SdfPath& path) const;
    [[nodiscard]] bool hadSpec(const pxr::SdfPath& path) const;
    [[nodiscard]] bool takesChildren(const pxr::SdfPath& prim) const;
    LayerResult<Paths> change(Table changed);
    void follow(Table locks);
    void admit();
    void enforceAll();
    void takeShadows();
    [[nodiscard]] bool covers(const pxr::SdfPath& path) const;
    [[nodiscard]] bool hasLockBelow(const pxr::SdfPath& path) const;
    void takeShadow(const pxr::SdfLayerHandle& layer, Shadow& shadow);
    void refuse(const pxr::SdfLayerHandle& layer, const pxr::SdfPath& path);
    void enforceLayer(const pxr::SdfLayerHandle& layer, Shadow& shadow);
    void removeAdditions(const pxr::SdfLayerHandle& layer, const std::set<pxr::SdfPath>& changed);
    bool moveBack(const pxr::SdfLayerHandle& layer, Shadow& shadow, const pxr::SdfPath& path);
    static void adopt(const pxr::SdfLayerHandle& layer, Shadow& shadow, const pxr::SdfPath& path);
    void restoreMissing(const pxr::SdfLayerHandle& layer, Shadow& shadow, const pxr::SdfPath& path);
    void enforce(const pxr::SdfLayerHandle& layer, Shadow& shadow, const pxr::SdfPath& path);
    void restore(const pxr::SdfLayerHandle& layer, const Shadow& shadow, const pxr::SdfPath& path);
    void restoreBelow(const pxr::SdfLayerHandle& layer, const Shadow& shadow,
                      const pxr::SdfPath& path);
    void removeStray(const pxr::SdfLayerHandle& layer, const pxr::SdfPath& path);

    LayersContext& context_;
    const UserName user_;
    Table locks_;
    Table incoming_;                         // take effect after earlier edits have been checked
    std::map<std::string, Shadow> shadows_;  // keyed by the layer's identifier
    // The results of takesChildren() since the last update().
    mutable std::map<pxr::SdfPath, bool> takesChildren_;
    std::set<pxr::SdfPath> released_;  // properties that were unlocked below a locked prim
    bool structureKnown_ = false;
    bool changing_ = false;
    pxr::SdfLayerHandle delegate_;
    std::vector<RefusedEdit> refused_;
};

}  // namespace usdlive::layers
