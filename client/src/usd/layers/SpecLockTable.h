// The table of locks of specs.
#pragma once

#include <pxr/usd/sdf/path.h>

#include <map>
#include <set>
#include <vector>

#include "usdlive/common/core/Id.h"

namespace usdlive::layers {

/// The locks of specs and their owners. A value.
///
/// A new lock is pending until admit(), because edits that were written before it stay. An unlocked
/// spec is free at once, so that an edit of the same frame stays.
class SpecLockTable {
public:
    using Locks = std::map<pxr::SdfPath, UserName>;

    /// Returns the locks in effect.
    [[nodiscard]] const Locks& inEffect() const { return inEffect_; }
    /// Returns the locks in effect and those that are pending.
    [[nodiscard]] Locks all() const;
    [[nodiscard]] bool isLocked(const pxr::SdfPath& path) const;

    /// Takes these as all locks. Returns the specs that were locked or unlocked.
    std::vector<pxr::SdfPath> assign(Locks locks);
    /// Lets the pending locks take effect. Returns false if there are none.
    bool admit();

    // --- the locks in effect

    [[nodiscard]] bool holds(const pxr::SdfPath& path) const { return inEffect_.contains(path); }
    /// Returns true if the spec or a prim above it is locked.
    [[nodiscard]] bool covers(const pxr::SdfPath& path) const;
    /// Returns true if the spec or one below it is locked.
    [[nodiscard]] bool hasLockBelow(const pxr::SdfPath& path) const;
    /// Returns the locked specs at and below the path, parents first.
    [[nodiscard]] std::vector<pxr::SdfPath> below(const pxr::SdfPath& path) const;
    /// Returns true for a property that was unlocked while its prim stayed locked.
    [[nodiscard]] bool isReleased(const pxr::SdfPath& path) const {
        return released_.contains(path);
    }

private:
    Locks inEffect_;
    Locks pending_;
    std::set<pxr::SdfPath> released_;
};

}  // namespace usdlive::layers
