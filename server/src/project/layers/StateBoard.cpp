// Computes the states of layers and sends them when they change.
#include "project/layers/StateBoard.h"

#include <algorithm>

#include "usdlive/common/layer/GlobalMuteness.h"

namespace usdlive::server {

namespace {

const std::string kStatesFeature = "states";

/// Compares states without their revisions: otherwise every commit would send a state.
bool isSame(LayerState state, const LayerState& other) {
    state.revision = other.revision;
    return state == other;
}

/// Returns the default state of a layer with the same file: saved, up to date, writable, not muted,
/// unlocked and not open. Such a state is not sent initially.
LayerState plain(const LayerState& state) {
    LayerState plain;
    plain.layer = state.layer;
    plain.saved = state.saved;
    plain.owner = state.owner;
    return plain;
}

}  // namespace

LayerLock StateBoard::lockAt(const LayerId& layer) const {
    if (const LayerDoc* doc = line_->doc(layer)) return lockOf(*doc);
    const auto known = locks_.find(layer);
    return known == locks_.end() ? LayerLock() : known->second;
}

LayerState StateBoard::stateOf(const LayerId& layer, const std::set<LayerId>& muted) const {
    const Revision saved = files_->saved(layer).revision;
    LayerState state;
    state.layer = layer;
    state.revision = std::max(layers_->changed(layer), saved);
    state.saved = saved;
    state.dirty = files_->isDirty(layer);
    state.outdated = files_->isOutdated(layer);
    state.writable = files_->present(layer).writable;
    state.owner = files_->present(layer).owner;
    const LayerLock lock = lockAt(layer);
    state.locked = lock.locked;
    state.holder = lock.holder;
    state.lockedAtMs = std::uint64_t(lock.atMs);
    state.globallyMuted = muted.contains(layer);
    const std::set<UserName> editors = sessions_->editors(layer);
    state.editors.assign(editors.begin(), editors.end());
    return state;
}

void StateBoard::announce() {
    if (suspects_->empty()) return;
    const std::set<LayerId> muted = mutedLayers();
    LayerStates message;
    std::erase_if(*suspects_, [&](const LayerId& layer) {
        if (!layers_->has(layer)) return true;
        if (layers_->changed(layer) > line_->durable()) return false;
        LayerState state = stateOf(layer, muted);
        const auto [sent, isFirst] = sent_.try_emplace(layer);
        if (isFirst) sent->second = plain(state);
        if (isSame(state, sent->second)) return true;
        sent->second = std::move(state);
        message.layers.push_back(sent->second);
        return true;
    });
    if (!message.layers.empty()) sessions_->sendToSubscribers(kStatesFeature, message);
}

void StateBoard::sendAllTo(const Session& session) {
    if (!session.features.contains(kStatesFeature)) return;
    LayerStates message;
    for (const auto& [layer, sent] : sent_)
        if (!isSame(sent, plain(sent))) message.layers.push_back(sent);
    outbox_->sendInitialState(session.id, message);
}

// ---- changes of states

void StateBoard::ordered(const OrderedCommit& commit) {
    for (const LayerId& layer : commit.layers) {
        const auto sent = sent_.find(layer);
        if (sent == sent_.end() || !sent->second.dirty) suspects_->insert(layer);
    }
    suspects_->insert(commit.layerData.begin(), commit.layerData.end());
}

void StateBoard::durable(const OrderedCommit& commit) {
    for (const LayerId& layer : commit.layerData) {
        const LayerDoc* doc = line_->doc(layer);
        if (!doc || line_->isLayerDataInFlight(layer)) continue;
        const std::set<LayerId> before = mutedBy(layer);
        updateMutes(layer, *doc);
        updateLock(commit.user, layer, *doc);
        logMutes(commit.user, layer, before);
    }
}

void StateBoard::loaded(const LayerId& layer, const LoadedLayer& loaded) {
    locks_[layer] = lockOf(loaded.doc);
    updateMutes(layer, loaded.doc);
}

void StateBoard::removed(const LayerId& layer) {
    sent_.erase(layer);
    locks_.erase(layer);
}

std::set<LayerId> StateBoard::mutedLayers() const {
    std::set<LayerId> muted;
    for (const auto& [root, mutes] : mutes_) muted.insert(mutes.begin(), mutes.end());
    return muted;
}

std::set<LayerId> StateBoard::mutedBy(const LayerId& root) const {
    const auto found = mutes_.find(root);
    return found == mutes_.end() ? std::set<LayerId>() : found->second;
}

void StateBoard::updateMutes(const LayerId& layer, const LayerDoc& doc) {
    std::set<LayerId> mutes = globallyMuted(layer, doc);
    const auto before = mutes_.find(layer);
    if (before != mutes_.end()) suspects_->insert(before->second.begin(), before->second.end());
    suspects_->insert(mutes.begin(), mutes.end());
    if (mutes.empty())
        mutes_.erase(layer);
    else
        mutes_[layer] = std::move(mutes);
}

void StateBoard::logMutes(const UserName& user, const LayerId& root,
                          const std::set<LayerId>& before) {
    const std::set<LayerId> now = mutedBy(root);
    for (const LayerId& layer : now)
        if (!before.contains(layer))
            activity_->record({"layer muted", user, layer, "on " + root.value});
    for (const LayerId& layer : before)
        if (!now.contains(layer))
            activity_->record({"layer unmuted", user, layer, "on " + root.value});
}

void StateBoard::updateLock(const UserName& user, const LayerId& layer, const LayerDoc& doc) {
    const LayerLock now = lockOf(doc);
    const LayerLock before = std::exchange(locks_[layer], now);
    if (now.locked == before.locked && now.holder == before.holder) return;
    if (now.locked)
        activity_->record({"layer locked", user, layer});
    else
        activity_->record({"layer unlocked", user, layer,
                           before.holder == user ? "" : "it was " + before.holder.value + "'s"});
}

}  // namespace usdlive::server
