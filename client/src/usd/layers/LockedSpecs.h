// The locked specs of a stage.
#pragma once

#include <pxr/usd/sdf/changeList.h>
#include <pxr/usd/sdf/layer.h>

#include <optional>
#include <vector>

#include "usd/layers/LockEnforcement.h"
#include "usd/layers/SpecLockTable.h"
#include "usdlive/client/usd/layers/SpecsLocking.h"

namespace usdlive::layers {

struct LayersContext;

/// Reads and writes the locks of specs in the root layer's customLayerData, and lets
/// LockEnforcement take back edits of locked specs. SpecsLocking shows it to users and says what
/// the functions do.
class LockedSpecs {
public:
    using Paths = SpecsLocking::Paths;
    using Unlocked = SpecsLocking::Unlocked;

    LockedSpecs(LayersContext& context, UserName user);

    LayerResult<Paths> lockSpec(const pxr::SdfPath& path, bool hierarchy);
    Unlocked unlockSpec(const pxr::SdfPath& path, bool hierarchy);
    Unlocked unlockAllSpecs();
    [[nodiscard]] Paths allLockedSpecs() const;
    [[nodiscard]] bool isSpecLocked(const pxr::SdfPath& path) const;
    [[nodiscard]] std::optional<LayerError> whyLocked(const pxr::SdfPath& spec) const;

    /// Call when the root layer's customLayerData has changed. Writes nothing, because it may be
    /// called inside a notice.
    void dataChanged();
    void layerChanged(const pxr::SdfLayerHandle& layer, const pxr::SdfChangeList& changes);
    /// Call when the layers of the stack have changed.
    void structureChanged();
    /// Takes back forbidden edits, within the caller's change block. Does not change the delegate.
    [[nodiscard]] std::vector<RefusedEdit> update(const pxr::SdfLayerHandle& delegate);

private:
    using Locks = SpecLockTable::Locks;

    [[nodiscard]] bool isForeign(const UserName& owner) const;
    template <class Chosen>
    Unlocked unlock(Chosen chosen);
    LayerResult<Paths> change(Locks changed);
    void follow(Locks locks);
    void admit();

    LayersContext& context_;
    const UserName user_;
    SpecLockTable table_;
    LockEnforcement enforcement_;
    bool changing_ = false;
};

}  // namespace usdlive::layers
