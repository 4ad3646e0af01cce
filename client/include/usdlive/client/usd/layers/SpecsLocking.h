// Locks of specs.
#pragma once

#include <pxr/usd/sdf/path.h>

#include <optional>
#include <vector>

#include "usdlive/client/usd/layers/LayerTypes.h"

namespace usdlive::layers {

class LockedSpecs;

/// The specs that accept no edits. Kept in the root layer's customLayerData,
/// `omni_layer:specs_locking` {spec path: user who locked it}, so that locks are shared live and
/// saved. A flat set of exact paths. Part of a Layers, which returns it.
///
/// Layers::update() takes back edits of locked specs in any layer of the stack, to the content at
/// the time of the lock. A locked prim accepts no new properties, and no new children if all its
/// existing children are locked. Edits from a live connection are part of the project and stay.
class SpecsLocking {
public:
    using Paths = std::vector<pxr::SdfPath>;

    SpecsLocking(const SpecsLocking&) = delete;
    SpecsLocking& operator=(const SpecsLocking&) = delete;

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

private:
    friend class Layers;
    explicit SpecsLocking(LockedSpecs& specs) : specs_(specs) {}

    LockedSpecs& specs_;
};

}  // namespace usdlive::layers
