// Layers that nobody has open leave the memory. What is known of them beside their content
// stays; whoever needs them has them loaded again from the store.
#include <algorithm>

#include "ProjectImpl.h"

namespace usdlive::server {

namespace {

/// What a loaded layer takes in memory, about, beside the bytes it is stored in.
constexpr std::size_t kSpecBytes = 512;

}  // namespace

/// To be called when a layer has been loaded, or a session has left it.
void Project::Impl::noteIdle(const LayerId& layer) {
    const auto entry = layers_.find(layer);
    const auto doc = docs_.find(layer);
    if (entry == layers_.end() || doc == docs_.end() || entry->second.idle != 0) return;
    if (isOpen(layer)) return;  // it is noted when it is closed
    const std::size_t bytes = kSpecBytes * doc->second.specCount() + entry->second.snapshotBytes +
                              entry->second.replayCost;
    entry->second.idle = ++lastIdle_;
    idle_.emplace(lastIdle_, IdleLayer{layer, ports_.clock.wallClockMs(), bytes});
    idleBytes_ += bytes;
}

/// The layers that decide what is locked in others (LK5): of root layers that lock specs, all that
/// is in their local layer stacks.
std::set<LayerId> Project::Impl::lockingStacks() const {
    std::set<LayerId> stacks(access_.lockingRoots());
    std::vector<LayerId> next(access_.lockingRoots().begin(), access_.lockingRoots().end());
    while (!next.empty()) {
        const LayerId from = std::move(next.back());
        next.pop_back();
        const auto doc = docs_.find(from);
        if (doc == docs_.end()) continue;
        for (LayerId& sub : subLayersOf(from, doc->second))
            if (stacks.insert(sub).second) next.push_back(std::move(sub));
    }
    return stacks;
}

bool Project::Impl::isOpen(const LayerId& layer) const {
    return std::ranges::any_of(sessions_,
                               [&](const auto& one) { return one.second.open.contains(layer); });
}

/// What is executed or under way needs its content.
bool Project::Impl::isNeeded(const LayerId& layer, const LayerEntry& entry) const {
    const auto waits = [&](const auto& session) {
        return std::ranges::any_of(session.second.transactions, [&](const auto& queued) {
            return std::ranges::any_of(queued.transaction.edits,
                                       [&](const Edit& edit) { return edit.layer == layer; });
        });
    };
    return entry.changed > durable_ || entry.saved.revision > durable_ ||
           std::ranges::any_of(saves_,
                               [&](const auto& save) { return save.layers.contains(layer); }) ||
           std::ranges::any_of(reloads_,
                               [&](const auto& reload) {
                                   return reload.waiting.contains(layer) ||
                                          reload.reading.contains(layer);
                               }) ||
           std::ranges::any_of(sessions_, waits);
}

/// The layer that was left first goes first. One that is needed has its turn later.
void Project::Impl::unloadIdle() {
    const std::int64_t now = ports_.clock.wallClockMs();
    std::optional<std::set<LayerId>> locking;
    for (std::size_t left = idle_.size(); left > 0; --left) {
        const auto first = idle_.begin();
        if (idleBytes_ <= options_.idleLayerBytes &&
            now - first->second.sinceMs < options_.idleLayerMs)
            return;
        const IdleLayer idle = std::move(first->second);
        idle_.erase(first);
        idleBytes_ -= idle.bytes;
        const auto found = layers_.find(idle.layer);
        if (found == layers_.end()) continue;
        LayerEntry& entry = found->second;
        entry.idle = 0;
        if (!std::holds_alternative<Loaded>(entry.state) || isOpen(idle.layer)) continue;
        if (!locking) locking = lockingStacks();
        if (locking->contains(idle.layer) || isNeeded(idle.layer, entry)) {
            noteIdle(idle.layer);
            continue;
        }
        const auto doc = docs_.find(idle.layer);
        entry.lock = lockOf(doc->second);
        docs_.erase(doc);
        entry.state = NotLoaded{};
        ++counters_.unloaded;
    }
}

}  // namespace usdlive::server
