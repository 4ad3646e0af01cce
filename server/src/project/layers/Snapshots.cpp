// Takes snapshots of layers and passes them to the store.
#include "project/layers/Snapshots.h"

namespace usdlive::server {

std::size_t Snapshots::storedBytes(const LayerId& layer) const {
    const auto found = layers_.find(layer);
    return found == layers_.end() ? 0 : found->second.bytes + found->second.replayCost;
}

void Snapshots::takeIfDue(const LayerId& layer, Entry& entry) {
    if (entry.isTaken || entry.replayCost < limits_.leastReplay) return;
    const LayerDoc* doc = line_->doc(layer);
    if (!doc) return;
    if (entry.replayCost < snapshotDue(*doc, entry.bytes, limits_.leastReplay)) return;
    const std::int64_t now = clock_->steadyMs();
    if (entry.takenMs && now - *entry.takenMs < limits_.intervalMs) return;
    entry.takenMs = now;
    entry.replayCost = 0;
    entry.isTaken = true;
    pending_.push_back({layer, *doc, line_->executed(), line_->executedHash()});
}

void Snapshots::kept(const LayerId& layer, const Result<std::size_t>& bytes) {
    Entry& entry = layers_[layer];
    entry.isTaken = false;
    if (bytes) entry.bytes = *bytes;
}

void Snapshots::loaded(const LayerId& layer, const LoadedLayer& loaded) {
    Entry& entry = layers_[layer];
    entry.replayCost = loaded.replayed.cost;
    entry.bytes = loaded.replayed.snapshotBytes;
}

void Snapshots::ready(const LayerId& layer, bool /*imported*/) {
    takeIfDue(layer, layers_[layer]);
    becameDurable(line_->durable());
}

void Snapshots::ordered(const OrderedCommit& commit) {
    for (const LayerId& layer : commit.layers) {
        Entry& entry = layers_[layer];
        entry.replayCost += replayCost(commit.frameBytes, commit.edits);
        takeIfDue(layer, entry);
    }
}

void Snapshots::becameDurable(Revision upTo) {
    while (!pending_.empty() && pending_.front().revision <= upTo) {
        const Pending pending = std::move(pending_.front());
        pending_.pop_front();
        history_->keepSnapshot(pending.layer, pending.doc, pending.revision, pending.hash);
    }
}

void Snapshots::rolledBack(const Error& /*error*/, const LostCommits& /*lost*/) {
    std::erase_if(pending_, [this](const Pending& pending) {
        if (pending.revision <= line_->durable()) return false;
        layers_[pending.layer].isTaken = false;
        layers_[pending.layer].takenMs.reset();
        return true;
    });
}

}  // namespace usdlive::server
