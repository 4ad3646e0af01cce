// Connects the parts of the states of a stage's layers.
#include "usd/layers/StageLayerStates.h"

#include <optional>
#include <utility>

#include "usd/layers/LayersContext.h"

namespace usdlive::layers {

namespace {

constexpr double kCheckEveryMs = 500;

}  // namespace

StageLayerStates::StageLayerStates(LayersContext& layersContext)
    : context(layersContext),
      muteness(context,
               [this](const std::string& id) {
                   const auto* layer = layers.find(id);
                   return layer && layer->local;
               }),
      layers(context, muteness,
             [this](const StageLayers::Difference& difference) { found(difference); }),
      locks(context, layers),
      dirtiness(context, layers),
      files(context, layers) {
    (void)layers.local();  // finds the layers
}

void StageLayerStates::found(const StageLayers::Difference& difference) {
    locks.layersFound();
    for (const auto& id : difference.removed) {
        dirtiness.remove(id);
        files.remove(id);
    }
    for (const auto* layer : difference.added) {
        const bool hasFile = layer->layer && !layer->layer->IsAnonymous();
        const auto live = hasFile ? context.liveState(layer->layer) : std::nullopt;
        dirtiness.add(layer->id, live);
        files.add(*layer, live);
    }
    nextCheckMs_ = 0;
}

void StageLayerStates::dataChanged(const pxr::SdfLayerHandle& layer) {
    if (layer == context.host.rootLayer()) muteness.flagsChanged();
    locks.dataChanged(layer);
}

void StageLayerStates::watch(double nowMs) {
    muteness.follow();
    dirtiness.followEdits();
    if (nowMs < nextCheckMs_) return;
    nextCheckMs_ = nowMs + kCheckEveryMs;
    layers.check();
    check();
    nextCheckMs_ = nowMs + kCheckEveryMs;
}

void StageLayerStates::notify(LayerEventType type, std::vector<std::string> ids) {
    if (!ids.empty()) context.events.push(type, std::move(ids));
}

void StageLayerStates::check() {
    std::vector<std::string> dirty, outdated, permission, reload;
    for (const auto& [id, layer] : layers.allKnown()) {
        if (!layer.layer || layer.layer->IsAnonymous()) continue;
        const auto live = context.liveState(layer.layer);
        if (live && dirtiness.check(id, *live)) dirty.push_back(id);
        const auto changes = files.check(layer, live);
        if (changes.outdated) outdated.push_back(id);
        if (changes.permission) permission.push_back(id);
        if (changes.reload && autoReloads.covers(layer)) reload.push_back(id);
    }
    notify(LayerEventType::DirtyStateChanged, std::move(dirty));
    notify(LayerEventType::OutdateStateChanged, std::move(outdated));
    notify(LayerEventType::LayerFilePermissionChanged, std::move(permission));
    if (!reload.empty()) files.reload(reload);
}

void StageLayerStates::reloadAutomatically() {
    nextCheckMs_ = 0;
    std::vector<std::string> live;
    for (const auto& [id, layer] : layers.allKnown())
        if (files.isOutdated(layer) && autoReloads.covers(layer) && context.liveState(layer.layer))
            live.push_back(id);
    if (!live.empty()) files.reload(live);
}

}  // namespace usdlive::layers
