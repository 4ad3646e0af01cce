// Follows which layers are dirty.
#include "usd/layers/LayerDirtiness.h"

#include <utility>

#include "usd/layers/LayersContext.h"

namespace usdlive::layers {

LayerDirtiness::LayerDirtiness(LayersContext& context, StageLayers& layers)
    : context_(context), layers_(layers) {}

void LayerDirtiness::add(const std::string& id, const std::optional<LiveState>& live) {
    auto& state = states_[id] = {};
    if (!live) return;
    state.dirty = live->dirty;
    state.saved = live->saved;
}

bool LayerDirtiness::isDirty(const StageLayers::Layer& layer) const {
    if (!layer.layer || layer.layer->IsAnonymous()) return false;
    const auto live = context_.liveState(layer.layer);
    if (!live) return layer.layer->IsDirty();
    const auto state = states_.find(layer.id);
    return state == states_.end() ? live->dirty : isDirty(state->second, *live);
}

// Own edits are dirty before the server's state shows it, until they are saved.
bool LayerDirtiness::isDirty(const State& state, const LiveState& live) {
    return live.dirty || (state.editedAt && (live.pending || *state.editedAt == live.saved));
}

void LayerDirtiness::sdfReports(const pxr::SdfLayerHandle& layer) {
    if (!layer || layer->IsAnonymous() || !layers_.find(layer->GetIdentifier())) return;
    // The server reports the state of a live layer; its local file is a placeholder.
    if (!context_.liveState(layer))
        context_.events.push(LayerEventType::DirtyStateChanged, {layer->GetIdentifier()});
}

void LayerDirtiness::edited(const pxr::SdfLayerHandle& layer) {
    if (!context_.live || context_.live->isApplying()) return;
    const auto found = states_.find(layer->GetIdentifier());
    if (found == states_.end() || found->second.dirty) return;
    const auto* known = layers_.known(found->first);
    const auto live = known ? context_.liveState(known->layer) : std::nullopt;
    if (!live) return;
    auto& state = found->second;
    state.editedAt = live->saved;
    state.acknowledged = false;
    state.dirty = true;
    edited_.insert(found->first);
    context_.events.push(LayerEventType::DirtyStateChanged, {found->first});
}

// Returns whether the layer became dirty or clean, or was saved, since the last call.
bool LayerDirtiness::follow(State& state, const LiveState& live) {
    const bool dirty = isDirty(state, live);
    if (live.dirty || !dirty) state.editedAt.reset();
    const Revision before = std::exchange(state.saved, live.saved);
    const bool wasSaved = before != 0 && before != live.saved;
    return std::exchange(state.dirty, dirty) != dirty || wasSaved;
}

void LayerDirtiness::followEdits() {
    std::erase_if(edited_, [&](const std::string& id) {
        const auto* layer = layers_.known(id);
        const auto live = layer ? context_.liveState(layer->layer) : std::nullopt;
        if (!live) return true;
        auto& state = states_[id];
        if (follow(state, *live)) context_.events.push(LayerEventType::DirtyStateChanged, {id});
        return !state.editedAt;
    });
}

bool LayerDirtiness::check(const std::string& id, const LiveState& live) {
    auto& state = states_[id];
    // An edit that the server refused never makes its state dirty.
    if (std::exchange(state.acknowledged, !live.pending) && !live.pending) state.editedAt.reset();
    return follow(state, live);
}

}  // namespace usdlive::layers
