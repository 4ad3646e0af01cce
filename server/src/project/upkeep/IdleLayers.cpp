// Removes layers that are not in use from memory.
#include "project/upkeep/IdleLayers.h"

#include <optional>
#include <utility>

namespace usdlive::server {

namespace {

/// The estimated memory of a spec in a loaded layer, in addition to its stored bytes.
constexpr std::size_t kSpecBytes = 512;

}  // namespace

IdleLayers::IdleLayers(const Limits& limits, const Parts& parts, ports::Clock& clock,
                       ProjectCounters& counters)
    : limits_(limits),
      line_(parts.line),
      layers_(parts.layers),
      files_(parts.files),
      snapshots_(parts.snapshots),
      sessions_(parts.sessions),
      access_(parts.access),
      submissions_(parts.submissions),
      saves_(parts.saves),
      reloads_(parts.reloads),
      clock_(clock),
      counters_(counters) {}

/// Adds a layer if it is idle. Called when a layer is loaded, and when a session has opened or
/// closed it.
void IdleLayers::add(const LayerId& layer) {
    const LayerDoc* doc = line_->doc(layer);
    if (!doc || !layers_->has(layer) || added_.contains(layer) || sessions_->isOpen(layer)) return;
    const std::size_t bytes = kSpecBytes * doc->specCount() + snapshots_->storedBytes(layer);
    idle_.emplace(++last_, Idle{layer, clock_->steadyMs(), bytes});
    added_.insert(layer);
    bytes_ += bytes;
}

/// Returns the layers that decide about spec locks (LK5): those in the local layer stacks of root
/// layers that lock specs.
std::set<LayerId> IdleLayers::lockingStacks() const {
    std::set<LayerId> stacks(access_->lockingRoots());
    std::vector<LayerId> next(stacks.begin(), stacks.end());
    while (!next.empty()) {
        const LayerId from = std::move(next.back());
        next.pop_back();
        const LayerDoc* doc = line_->doc(from);
        if (!doc) continue;
        for (LayerId& sub : subLayersOf(from, *doc))
            if (stacks.insert(sub).second) next.push_back(std::move(sub));
    }
    return stacks;
}

/// Returns whether an unfinished commit or operation needs the layer.
bool IdleLayers::isNeeded(const LayerId& layer) const {
    const Revision durable = line_->durable();
    return layers_->changed(layer) > durable || files_->saved(layer).revision > durable ||
           saves_->needs(layer) || reloads_->needs(layer) || submissions_->needs(layer);
}

void IdleLayers::unload() {
    const std::int64_t now = clock_->steadyMs();
    std::optional<std::set<LayerId>> locking;
    for (std::size_t left = idle_.size(); left > 0; --left) {
        const auto first = idle_.begin();
        if (bytes_ <= limits_.bytes && now - first->second.sinceMs < limits_.layerMs) return;
        const Idle idle = std::move(first->second);
        idle_.erase(first);
        added_.erase(idle.layer);
        bytes_ -= idle.bytes;
        if (!layers_->isLoaded(idle.layer) || sessions_->isOpen(idle.layer)) continue;
        if (!locking) locking = lockingStacks();
        if (locking->contains(idle.layer) || isNeeded(idle.layer)) {
            add(idle.layer);
            continue;
        }
        layers_->unload(idle.layer);
        ++counters_->unloaded;
    }
}

}  // namespace usdlive::server
