// Who may edit single specs that are locked (LK5).
#include <algorithm>
#include <utility>

#include "ProjectImpl.h"
#include "usdlive/common/layer/FieldParts.h"
#include "usdlive/common/layer/SpecPath.h"

namespace usdlive::server {

namespace {

/// An `over` says nothing: it may be created so that specs below can be edited. An over of a spec
/// that was there is an edit.
bool isHarmless(const ExecutedEdit& executed, const LayerDoc& before) {
    const auto& [edit, applied] = executed;
    if (std::holds_alternative<CreateSpec>(edit.action)) return true;
    const auto* set = std::get_if<SetField>(&edit.action);
    if (!set || set->field != "specifier") return false;
    return !applied.changed || (makesOver(*set) && !before.has(edit.address.path));
}

bool takesWithAllBelow(const EditAction& action) {
    return std::holds_alternative<DeleteSpec>(action) || std::holds_alternative<MoveSpec>(action);
}

Error lockedError(const std::string& path, const UserName& owner) {
    return {ErrorCode::Locked, path + " is locked" + (owner.empty() ? "" : " by " + owner.value)};
}

}  // namespace

/// To be called when a layer has been loaded, or its custom layer data edited.
void Project::Impl::noteSpecLocks(const LayerId& layer) {
    const auto doc = docs_.find(layer);
    if (doc == docs_.end() || specLocksOf(doc->second).empty())
        specLockers_.erase(layer);
    else
        specLockers_.insert(layer);
}

/// Do the edits have to be looked at once they are executed?
bool Project::Impl::mindsSpecLocks(const std::vector<Edit>& edits) const {
    if (!specLockers_.empty()) return true;
    return std::any_of(edits.begin(), edits.end(),
                       [](const Edit& edit) { return touchesSpecLocks(edit.action); });
}

/// The locks that hold in a layer: those of every root layer in whose local layer stack it is.
SpecLocks Project::Impl::specLocksIn(const LayerId& layer, const LayerDocs& before) const {
    SpecLocks locks;
    for (const LayerId& root : specLockers_) {
        std::set<LayerId> stack{root};
        std::vector<LayerId> next{root};
        while (!next.empty() && !stack.contains(layer)) {
            const auto doc = docs_.find(next.back());
            const LayerId from = std::move(next.back());
            next.pop_back();
            if (doc == docs_.end()) continue;
            for (LayerId& sub : subLayersOf(from, doc->second))
                if (stack.insert(sub).second) next.push_back(std::move(sub));
        }
        if (!stack.contains(layer)) continue;
        const auto earlier = before.find(root);
        locks.merge(specLocksOf(earlier == before.end() ? docs_.at(root) : earlier->second));
    }
    return locks;
}

bool Project::Impl::isForeign(const UserName& owner, const UserName& user) const {
    return !options_.administrators.contains(user) && owner != user;
}

/// The lock of somebody else on the spec that an edit is for or, when it takes those below with it,
/// on one of these. `doc`: the layer before the edit.
std::optional<Error> Project::Impl::specLockOn(const UserName& user, const Edit& edit,
                                               const SpecLocks& locks, const LayerDoc* doc) const {
    const std::string path = withoutVariants(edit.address.path);
    if (const auto lock = locks.find(path); lock != locks.end() && isForeign(lock->second, user))
        return lockedError(path, lock->second);
    if (!takesWithAllBelow(edit.action) || !doc) return std::nullopt;
    for (auto lock = locks.lower_bound(path); lock != locks.end(); ++lock) {
        if (!lock->first.starts_with(path)) break;
        if (specpath::hasPrefix(lock->first, path) && isForeign(lock->second, user) &&
            doc->has(lock->first))
            return lockedError(lock->first, lock->second);
    }
    return std::nullopt;
}

/// A preview is not executed here, so its addresses are looked at as they are.
bool Project::Impl::previewMeetsSpecLock(const UserName& user,
                                         const std::vector<Edit>& edits) const {
    if (specLockers_.empty()) return false;
    std::map<LayerId, SpecLocks> known;
    return std::any_of(edits.begin(), edits.end(), [&](const Edit& edit) {
        if (edit.address.creation || edit.address.path == "/") return false;
        const auto found = docs_.find(edit.layer);
        const LayerDoc* doc = found == docs_.end() ? nullptr : &found->second;
        const auto* set = std::get_if<SetField>(&edit.action);
        const bool isNew = !doc || !doc->has(edit.address.path);
        if (std::holds_alternative<CreateSpec>(edit.action) || (set && isNew && makesOver(*set)))
            return false;
        const auto [entry, added] = known.try_emplace(edit.layer);
        if (added) entry->second = specLocksIn(edit.layer, {});
        return specLockOn(user, edit, entry->second, doc).has_value();
    });
}

/// Which of the edits somebody else's lock stands against, and why. `before`: the layers that were
/// edited, as they were.
std::optional<std::pair<std::size_t, Error>> Project::Impl::specLockObjection(
    const UserName& user, const std::vector<ExecutedEdit>& executed,
    const LayerDocs& before) const {
    std::map<LayerId, SpecLocks> known;
    const auto foreign = [&](const UserName& owner) { return isForeign(owner, user); };
    for (std::size_t index = 0; index < executed.size(); ++index) {
        const Edit& edit = executed[index].edit;
        const auto [entry, added] = known.try_emplace(edit.layer);
        if (added) entry->second = specLocksIn(edit.layer, before);
        const SpecLocks& locks = entry->second;
        if (locks.empty() || edit.address.path == "/" ||
            isHarmless(executed[index], before.at(edit.layer)))
            continue;
        if (auto locked = specLockOn(user, edit, locks, &before.at(edit.layer)))
            return std::pair(index, *std::move(locked));
    }
    // And the locks themselves.
    for (const auto& [layer, doc] : before) {
        const SpecLocks were = specLocksOf(doc), are = specLocksOf(docs_.at(layer));
        if (were == are) continue;
        const auto last = executed.size() - 1;
        for (const auto& [path, owner] : were) {
            const auto now = are.find(path);
            const bool stays = now != are.end() && now->second == owner;
            if (!stays && foreign(owner) && !isFree({true, owner, 0}))
                return std::pair(last, lockedError(path, owner));
        }
        for (const auto& [path, owner] : are)
            if (!were.contains(path) && !owner.empty() && foreign(owner))
                return std::pair(
                    last, Error{ErrorCode::Locked, "a lock is taken in one's own name, and " +
                                                       user.value + " is not " + owner.value});
    }
    return std::nullopt;
}

}  // namespace usdlive::server
