// Takes back edits of locked specs.
#pragma once

#include <pxr/usd/sdf/changeList.h>
#include <pxr/usd/sdf/layer.h>

#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "usd/layers/LockShadow.h"
#include "usd/layers/SpecLockTable.h"
#include "usdlive/client/usd/layers/LayerTypes.h"

namespace usdlive::layers {

struct LayersContext;

/// Takes back edits of locked specs, in all layers of the stack except the delegate. Keeps a shadow
/// of each layer, and restores what differs from it. Also decides which new specs below locked
/// prims are forbidden.
class LockEnforcement {
public:
    LockEnforcement(LayersContext& context, const SpecLockTable& locks);

    /// Returns the reason why the spec accepts no edits, or nothing if it does.
    [[nodiscard]] std::optional<LayerError> whyLocked(const pxr::SdfPath& spec) const;

    void layerChanged(const pxr::SdfLayerHandle& layer, const pxr::SdfChangeList& changes);
    /// Call when the layers of the stack have changed.
    void structureChanged() { structureKnown_ = false; }
    /// Call when locks took effect, which protect the present content.
    void locksAdmitted();

    /// Call at the begin of a frame. Children of prims are counted again.
    void beginFrame(const pxr::SdfLayerHandle& delegate);
    /// Takes back the forbidden edits so far, within the caller's change block.
    void enforce();
    /// Call at the end of a frame. Returns the refused edits.
    [[nodiscard]] std::vector<RefusedEdit> endFrame();

private:
    using Layer = pxr::SdfLayerHandle;
    using Path = pxr::SdfPath;

    /// Returns the prim or property at or above `path` that a locked prim did not have when it was
    /// locked.
    [[nodiscard]] std::optional<Path> additionAt(const Path& path) const;
    [[nodiscard]] bool hadSpec(const Path& path) const;
    [[nodiscard]] bool takesChildren(const Path& prim) const;
    void takeShadows();
    void refuse(const Layer& layer, const Path& path);
    void enforceLayer(const Layer& layer, LockShadow& shadow);
    void removeAdditions(const Layer& layer, const std::set<Path>& changed);
    void restoreMissing(const Layer& layer, LockShadow& shadow, const LockShadow::Edits& edits,
                        const Path& path);
    bool moveBack(const Layer& layer, LockShadow& shadow, const LockShadow::Edits& edits,
                  const Path& path);
    void enforceSpec(const Layer& layer, LockShadow& shadow, const Path& path);
    void restore(const Layer& layer, const LockShadow& shadow, const Path& path);
    void restoreBelow(const Layer& layer, const LockShadow& shadow, const Path& path);
    void removeStray(const Layer& layer, const Path& path);

    LayersContext& context_;
    const SpecLockTable& locks_;
    std::map<std::string, LockShadow> shadows_;  // keyed by the layer's identifier
    // The results of takesChildren() in this frame.
    mutable std::map<Path, bool> takesChildren_;
    bool structureKnown_ = false;
    Layer delegate_;
    std::vector<RefusedEdit> refused_;
};

}  // namespace usdlive::layers
