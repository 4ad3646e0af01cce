// Shows the locks of specs to users.
#include "usdlive/client/usd/layers/SpecsLocking.h"

#include "usd/layers/LockedSpecs.h"

namespace usdlive::layers {

using pxr::SdfPath;

LayerResult<SpecsLocking::Paths> SpecsLocking::lockSpec(const SdfPath& path, bool hierarchy) {
    return specs_.lockSpec(path, hierarchy);
}

SpecsLocking::Unlocked SpecsLocking::unlockSpec(const SdfPath& path, bool hierarchy) {
    return specs_.unlockSpec(path, hierarchy);
}

SpecsLocking::Unlocked SpecsLocking::unlockAllSpecs() { return specs_.unlockAllSpecs(); }

SpecsLocking::Paths SpecsLocking::allLockedSpecs() const { return specs_.allLockedSpecs(); }

bool SpecsLocking::isSpecLocked(const SdfPath& path) const { return specs_.isSpecLocked(path); }

std::optional<LayerError> SpecsLocking::whyLocked(const SdfPath& spec) const {
    return specs_.whyLocked(spec);
}

}  // namespace usdlive::layers
