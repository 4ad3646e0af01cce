// Keeps the locks of specs.
#include "usd/layers/SpecLockTable.h"

#include <utility>

namespace usdlive::layers {

using pxr::SdfPath;

SpecLockTable::Locks SpecLockTable::all() const {
    Locks locks = inEffect_;
    locks.insert(pending_.begin(), pending_.end());
    return locks;
}

bool SpecLockTable::isLocked(const SdfPath& path) const {
    return inEffect_.contains(path) || pending_.contains(path);
}

std::vector<SdfPath> SpecLockTable::assign(Locks locks) {
    const Locks now = all();
    std::vector<SdfPath> changed;
    if (locks == now) return changed;
    for (const auto& [path, owner] : locks)
        if (!now.contains(path)) changed.push_back(path);
    for (const auto& [path, owner] : now)
        if (!locks.contains(path)) changed.push_back(path);
    for (const auto& [path, owner] : locks) released_.erase(path);
    for (const auto& [path, owner] : now)
        if (path.IsPropertyPath() && !locks.contains(path) && locks.contains(path.GetPrimPath()))
            released_.insert(path);
    std::erase_if(inEffect_, [&](const auto& lock) { return !locks.contains(lock.first); });
    pending_ = std::move(locks);
    std::erase_if(pending_, [&](const auto& lock) { return inEffect_.contains(lock.first); });
    return changed;
}

bool SpecLockTable::admit() {
    if (pending_.empty()) return false;
    inEffect_.merge(pending_);
    pending_.clear();
    return true;
}

bool SpecLockTable::covers(const SdfPath& path) const {
    if (holds(path)) return true;
    for (SdfPath prim = path.GetPrimPath(); prim.IsPrimPath(); prim = prim.GetParentPath())
        if (holds(prim)) return true;
    return false;
}

bool SpecLockTable::hasLockBelow(const SdfPath& path) const {
    const auto first = inEffect_.lower_bound(path);
    return first != inEffect_.end() && first->first.HasPrefix(path);
}

std::vector<SdfPath> SpecLockTable::below(const SdfPath& path) const {
    std::vector<SdfPath> specs;
    for (auto lock = inEffect_.lower_bound(path);
         lock != inEffect_.end() && lock->first.HasPrefix(path); ++lock)
        specs.push_back(lock->first);
    return specs;
}

}  // namespace usdlive::layers
