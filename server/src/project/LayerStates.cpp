// What is known of layers beside their content: told to all who want it, when it changes.
#include <algorithm>

#include "ProjectImpl.h"
#include "usdlive/common/layer/GlobalMuteness.h"

namespace usdlive::server {

namespace {

const std::string kStatesFeature = "states";

/// That it has another revision is no reason to tell a state: every commit would be.
bool isSame(LayerState state, const LayerState& other) {
    state.revision = other.revision;
    return state == other;
}

/// Of a layer with the same file that is saved, up to date, writable, not muted, unlocked and open
/// nowhere: there is nothing to tell.
LayerState plain(const LayerState& state) {
    LayerState plain;
    plain.layer = state.layer;
    plain.saved = state.saved;
    plain.owner = state.owner;
    return plain;
}

}  // namespace

LayerLock Project::Impl::lockAt(const LayerId& layer) const {
    if (const auto doc = docs_.find(layer); doc != docs_.end()) return lockOf(doc->second);
    const auto entry = layers_.find(layer);
    return entry == layers_.end() ? LayerLock() : entry->second.lock;
}

LayerState Project::Impl::stateOf(const LayerId& layer, const LayerEntry& entry) const {
    LayerState state;
    state.layer = layer;
    state.revision = std::max(entry.changed, entry.saved.revision);
    state.saved = entry.saved.revision;
    state.dirty = entry.unsaved || entry.changed > entry.saved.revision || entry.file.missing;
    state.outdated = entry.file.outdated;
    state.writable = entry.file.present.writable;
    state.owner = entry.file.present.owner;
    const LayerLock lock = lockAt(layer);
    state.locked = lock.locked;
    state.holder = lock.holder;
    state.lockedAtMs = std::uint64_t(lock.atMs);
    std::set<UserName> editors;
    for (const auto& [id, session] : sessions_)
        if (session.isGreeted() && session.open.contains(layer))
            editors.insert(session.subject.user);
    state.editors.assign(editors.begin(), editors.end());
    return state;
}

/// What is not durable yet is not told: it might be taken back.
void Project::Impl::tellStates() {
    if (suspects_.empty()) return;
    const std::set<LayerId> muted = mutedLayers();
    LayerStates message;
    std::erase_if(suspects_, [&](const LayerId& layer) {
        const auto found = layers_.find(layer);
        if (found == layers_.end()) return true;
        LayerEntry& entry = found->second;
        if (entry.changed > durable_) return false;
        LayerState state = stateOf(layer, entry);
        state.globallyMuted = muted.contains(layer);
        if (entry.told.layer.empty()) entry.told = plain(state);
        if (isSame(state, entry.told)) return true;
        entry.told = std::move(state);
        message.layers.push_back(entry.told);
        return true;
    });
    if (message.layers.empty()) return;
    tellAll(kStatesFeature, message);
}

void Project::Impl::tellStatesTo(Session& session) {
    if (!session.features.contains(kStatesFeature)) return;
    LayerStates message;
    for (const auto& [layer, entry] : layers_)
        if (!entry.told.layer.empty() && !isSame(entry.told, plain(entry.told)))
            message.layers.push_back(entry.told);
    ports_.outbox.tellFirst(session.id, message);
}

std::set<LayerId> Project::Impl::mutedLayers() const {
    std::set<LayerId> muted;
    for (const auto& [root, mutes] : mutes_) muted.insert(mutes.begin(), mutes.end());
    return muted;
}

std::set<LayerId> Project::Impl::mutedBy(const LayerId& root) const {
    const auto found = mutes_.find(root);
    return found == mutes_.end() ? std::set<LayerId>() : found->second;
}

/// To be called when a layer has been loaded, or its custom layer data edited.
void Project::Impl::noteMutes(const LayerId& layer) {
    const auto doc = docs_.find(layer);
    if (doc == docs_.end()) return;
    std::set<LayerId> mutes = globallyMuted(layer, doc->second);
    const auto before = mutes_.find(layer);
    if (before != mutes_.end()) suspects_.insert(before->second.begin(), before->second.end());
    suspects_.insert(mutes.begin(), mutes.end());
    if (mutes.empty())
        mutes_.erase(layer);
    else
        mutes_[layer] = std::move(mutes);
}

void Project::Impl::closeLayer(Session& session, const LayerId& layer) {
    if (session.open.erase(layer) == 0) return;
    suspects_.insert(layer);
    noteIdle(layer);
}

}  // namespace usdlive::server
