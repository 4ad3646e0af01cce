// Checks and reloads the files of layers.
#include "usd/layers/LayerFileStates.h"

#include <utility>

#include "usd/layers/LayersContext.h"
#include "usdlive/client/usd/layers/LayerUtils.h"

namespace usdlive::layers {

LayerFileStates::LayerFileStates(LayersContext& context, StageLayers& layers)
    : context_(context), layers_(layers) {}

bool LayerFileStates::isOutdated(const StageLayers::Layer& layer) const {
    return outdated_.contains(layer.id);
}

bool LayerFileStates::isReadOnly(const StageLayers::Layer& layer) const {
    return readOnly_.contains(layer.id);
}

std::string LayerFileStates::ownerOf(const StageLayers::Layer& layer) const {
    if (const auto live = context_.liveState(layer.layer)) return live->owner;
    const auto owner = owners_.find(layer.id);
    return owner == owners_.end() ? std::string() : owner->second;
}

void LayerFileStates::add(const StageLayers::Layer& layer, const std::optional<LiveState>& live) {
    if (!layer.layer || layer.layer->IsAnonymous()) return;
    if (live) {
        readOnly_.assign(layer.id, !live->writable);
        return;
    }
    auto seen = FileWatch::glance(layer.layer->GetRealPath());
    readOnly_.assign(layer.id, seen.readOnly);
    owners_[layer.id] = std::move(seen.owner);
}

void LayerFileStates::remove(const std::string& id) {
    outdated_.assign(id, false);
    readOnly_.assign(id, false);
    owners_.erase(id);
}

LayerFileStates::Changes LayerFileStates::check(const StageLayers::Layer& layer,
                                                const std::optional<LiveState>& live) {
    Changes changes;
    if (live) {
        // Its local file is a placeholder.
        changes.permission = readOnly_.assign(layer.id, !live->writable);
        changes.outdated = outdated_.assign(layer.id, live->outdated);
        changes.reload = changes.outdated && live->outdated;
        return changes;
    }
    auto seen = watch_.look(layer.layer->GetRealPath());
    changes.permission = readOnly_.assign(layer.id, seen.readOnly);
    changes.outdated = outdated_.assign(layer.id, seen.changed);
    changes.reload = seen.changed;
    owners_[layer.id] = std::move(seen.owner);
    return changes;
}

bool LayerFileStates::reload(const std::vector<std::string>& ids) {
    std::vector<std::string> files;
    for (const auto& id : ids) {
        const auto* found = layers_.find(id);
        if (!found) continue;
        if (context_.liveState(found->layer)) {
            context_.live->reload(found->layer);
        } else {
            files.push_back(id);
        }
    }
    if (!files.empty() && !LayerUtils::reloadLayers(files)) return false;
    for (const auto& id : files) {
        const auto* found = layers_.find(id);
        if (!found || !found->layer) continue;
        watch_.accept(found->layer->GetRealPath());
        outdated_.assign(found->id, false);
    }
    return true;
}

void LayerFileStates::agrees(const pxr::SdfLayerHandle& layer) {
    if (!layer || layer->IsAnonymous()) return;
    const auto* found = layers_.known(layer->GetIdentifier());
    if (!found) return;
    watch_.accept(layer->GetRealPath());
    if (outdated_.assign(found->id, false))
        context_.events.push(LayerEventType::OutdateStateChanged, {found->id});
}

}  // namespace usdlive::layers
