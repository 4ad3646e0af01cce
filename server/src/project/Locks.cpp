// Who may edit a layer that is locked (LK1-LK4).
#include <map>

#include "ProjectImpl.h"

namespace usdlive::server {

namespace {

bool isOfPseudoRoot(const Edit& edit) { return edit.address.path == "/" && !edit.address.creation; }

Error lockedError(const LayerId& layer, const LayerLock& lock) {
    return {ErrorCode::Locked,
            layer.value + " is locked" + (lock.holder.empty() ? "" : " by " + lock.holder.value)};
}

}  // namespace

/// Also of a layer that was unloaded.
LayerLock Project::Impl::lockAt(const LayerId& layer) const {
    if (const auto doc = docs_.find(layer); doc != docs_.end()) return lockOf(doc->second);
    const auto entry = layers_.find(layer);
    return entry == layers_.end() ? LayerLock() : entry->second.lock;
}

bool Project::Impl::holds(const UserName& user, const LayerLock& lock) const {
    return options_.administrators.contains(user) || (!lock.holder.empty() && lock.holder == user);
}

/// May somebody else take or end it? Nobody is named, or who is has been away for long.
bool Project::Impl::isFree(const LayerLock& lock) const {
    if (lock.holder.empty()) return true;
    for (const auto& [id, session] : sessions_)
        if (session.isGreeted() && session.user == lock.holder) return false;
    const auto left = leftMs_.find(lock.holder);
    const std::int64_t since = left == leftMs_.end() ? startedMs_ : left->second;
    return ports_.clock.wallClockMs() - since >= options_.lockTakeoverMs;
}

std::optional<Error> Project::Impl::lockObjection(const UserName& user,
                                                  const LayerId& layer) const {
    const LayerLock lock = lockAt(layer);
    if (!lock.locked || holds(user, lock)) return std::nullopt;
    return lockedError(layer, lock);
}

/// Precondition: the layers are loaded.
std::optional<Refused> Project::Impl::lockObjection(const Session& session,
                                                    const Transaction& transaction) const {
    const LayerId* known = nullptr;
    LayerLock lock;
    std::map<LayerId, LayerDoc> changed;  // those whose lock may be another afterwards
    for (std::size_t index = 0; index < transaction.edits.size(); ++index) {
        const Edit& edit = transaction.edits[index];
        if (!known || *known != edit.layer) {
            lock = lockOf(docs_.at(edit.layer));
            known = &edit.layer;
        }
        const bool ofRoot = isOfPseudoRoot(edit);
        if (lock.locked && !holds(session.user, lock) &&
            !(ofRoot && isLockEdit(edit.action) && isFree(lock)))
            return Refused{lockedError(edit.layer, lock), std::uint32_t(index)};
        if (!ofRoot || !touchesLock(edit.action)) continue;
        const auto doc = changed.try_emplace(edit.layer, docs_.at(edit.layer)).first;
        (void)doc->second.apply(edit.address.path, edit.action);
        const LayerLock after = lockOf(doc->second);
        if (after.locked && after.holder != lock.holder && !after.holder.empty() &&
            !holds(session.user, after))
            return Refused{
                {ErrorCode::Locked, "a lock is taken in one's own name, and " + session.user.value +
                                        " is not " + after.holder.value},
                std::uint32_t(index)};
    }
    return std::nullopt;
}

}  // namespace usdlive::server
