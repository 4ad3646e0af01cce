// Answers queries about the layers of a stage and sets their flags, with the parts that keep them.
#include "usdlive/client/usd/layers/LayersState.h"

#include <utility>

#include "usd/layers/LayersContext.h"
#include "usd/layers/OmniLayerData.h"
#include "usd/layers/StageLayerStates.h"
#include "usdlive/client/usd/layers/LayerUtils.h"

namespace usdlive::layers {

std::optional<LayerError> LayersState::whyUnknown(const std::string& id) {
    return states_.layers.whyUnknown(id);
}

// ------------------------------------------------------------------ muteness

void LayersState::setMutenessScope(bool global) { states_.muteness.setScope(global); }

bool LayersState::isMutenessGlobal() const { return states_.muteness.isScopeGlobal(); }

void LayersState::mutenessChanged() { states_.muteness.stageChanged(); }

bool LayersState::isLayerMuted(const std::string& id) {
    states_.muteness.stageChanged();
    return states_.muteness.isMuted(states_.layers.idOf(id));
}

bool LayersState::isLayerLocallyMuted(const std::string& id) {
    return states_.muteness.isMutedLocally(states_.layers.idOf(id));
}

bool LayersState::isLayerGloballyMuted(const std::string& id) {
    return states_.muteness.isMutedGlobally(states_.layers.idOf(id));
}

LayerResult<void> LayersState::setLayerGlobalMuteness(const std::string& id, bool muted) {
    if (auto unknown = whyUnknown(id)) return tl::unexpected(std::move(*unknown));
    const std::string known = states_.layers.idOf(id);
    if (states_.layers.isRoot(known) || states_.layers.isSession(known))
        return fail(LayerErrorType::InvalidParam, id + " cannot be muted");
    return states_.muteness.setGlobally(known, muted);
}

// ------------------------------------------------------------------ locks

bool LayersState::isLayerLocked(const std::string& id) {
    const auto* layer = states_.layers.find(id);
    return layer && states_.locks.isLocked(*layer);
}

LayerResult<void> LayersState::setLayerLockState(const std::string& id, bool locked) {
    if (auto unknown = whyUnknown(id)) return tl::unexpected(std::move(*unknown));
    return states_.locks.setLocked(std::string(states_.layers.idOf(id)), locked);
}

// ------------------------------------------------------------------ writable

std::optional<LayerError> LayersState::whyNotWritable(const pxr::SdfLayerHandle& layer) {
    if (!layer) return LayerError{LayerErrorType::NotFound, "there is no such layer"};
    const std::string& id = layer->GetIdentifier();
    const auto* found = states_.layers.find(id);
    if (states_.muteness.isMuted(id)) return LayerError{LayerErrorType::ReadOnly, id + " is muted"};
    if (found && states_.locks.isLocked(*found)) {
        const auto live = states_.context.liveState(layer);
        const bool named = live && !live->lockHolder.empty();
        return LayerError{LayerErrorType::ReadOnly,
                          id + " is locked" + (named ? " by " + live->lockHolder.value : "")};
    }
    if (!layer->PermissionToEdit())
        return LayerError{LayerErrorType::ReadOnly, id + " does not permit edits"};
    if (found && states_.files.isReadOnly(*found))
        return LayerError{LayerErrorType::ReadOnly, "the file of " + id + " is read-only"};
    return std::nullopt;
}

bool LayersState::isLayerWritable(const std::string& id) {
    const auto* layer = states_.layers.find(id);
    return layer && !states_.files.isReadOnly(*layer) && !states_.muteness.isMuted(layer->id) &&
           !states_.locks.isLocked(*layer) && layer->layer && layer->layer->PermissionToEdit();
}

bool LayersState::isLayerReadonlyOnDisk(const std::string& id) {
    const auto* layer = states_.layers.find(id);
    return layer && states_.files.isReadOnly(*layer);
}

bool LayersState::isLayerSavable(const std::string& id) {
    if (!isLayerWritable(id)) return false;
    const auto* layer = states_.layers.find(id);
    return layer && !layer->layer->IsAnonymous() && layer->layer->PermissionToSave();
}

bool LayersState::isLayerDirty(const std::string& id) {
    const auto* layer = states_.layers.find(id);
    return layer && states_.dirtiness.isDirty(*layer);
}

std::vector<std::string> LayersState::dirtyLayerIdentifiers() {
    std::vector<std::string> dirty;
    for (const auto& id : states_.layers.used())
        if (isLayerDirty(id)) dirty.push_back(id);
    return dirty;
}

// ------------------------------------------------------------------ names

LayerResult<void> LayersState::setLayerName(const std::string& id, const std::string& name) {
    if (auto unknown = whyUnknown(id)) return tl::unexpected(std::move(*unknown));
    const auto* layer = states_.layers.find(id);
    if (!layer->layer) return fail(LayerErrorType::NotFound, id + " is not loaded");
    if (!LayerUtils::setCustomLayerName(layer->layer, name))
        return fail(LayerErrorType::ReadOnly, id + " does not permit edits");
    return {};
}

std::string LayersState::layerName(const std::string& id) {
    const auto* layer = states_.layers.find(id);
    const std::string& known = layer ? layer->id : id;
    if (states_.layers.isRoot(known)) return "Root Layer";
    if (states_.layers.isSession(known)) return "Session Layer";
    if (layer && layer->layer) {
        const auto custom = LayerUtils::customLayerName(layer->layer);
        if (!custom.empty()) return custom;
    }
    if (pxr::SdfLayer::IsAnonymousLayerIdentifier(id)) return id;
    return unquoted(pxr::SdfLayer::GetDisplayNameFromIdentifier(id));
}

std::string LayersState::layerOwner(const std::string& id) {
    const auto* layer = states_.layers.find(id);
    return layer ? states_.files.ownerOf(*layer) : std::string();
}

// ------------------------------------------------------------------ lists

std::vector<std::string> LayersState::localLayerIdentifiers(bool session, bool anonymous,
                                                            bool invalid) {
    std::vector<std::string> ids;
    for (const auto& id : states_.layers.local()) {
        if (!session && states_.layers.known(id)->session) continue;
        if (!anonymous && pxr::SdfLayer::IsAnonymousLayerIdentifier(id)) continue;
        ids.push_back(id);
    }
    const auto& missing = states_.layers.missing();
    if (invalid) ids.insert(ids.end(), missing.begin(), missing.end());
    return ids;
}

bool LayersState::hasLocalLayer(const std::string& id) {
    const auto* layer = states_.layers.find(id);
    return layer && layer->local;
}

bool LayersState::hasUsedLayer(const std::string& id) {
    const auto* layer = states_.layers.findUsed(id);
    return layer && layer->used;
}

// ------------------------------------------------------------------ files

bool LayersState::isLayerOutdated(const std::string& id) {
    const auto* layer = states_.layers.find(id);
    return layer && states_.files.isOutdated(*layer);
}

std::vector<std::string> LayersState::outdatedLayerIdentifiers(Which which, bool notAuto) {
    std::vector<std::string> ids;
    for (const auto& id : states_.layers.used()) {
        const auto& layer = *states_.layers.known(id);
        if (!states_.files.isOutdated(layer)) continue;
        if (notAuto && states_.autoReloads.covers(layer)) continue;
        if (which == Which::All || (which == Which::Sublayers) == layer.local) ids.push_back(id);
    }
    return ids;
}

LayerResult<void> LayersState::reloadOutdatedLayers(Which which, bool notAuto) {
    const auto ids = outdatedLayerIdentifiers(which, notAuto);
    if (ids.empty()) return {};
    const bool read = states_.files.reload(ids);
    states_.context.events.push(LayerEventType::OutdateStateChanged, ids);
    if (read) return {};
    return fail(LayerErrorType::NotFound, "not all outdated layers can be read");
}

// ------------------------------------------------------------------ auto reload

bool LayersState::isAutoReloadLayer(const std::string& id) {
    const auto* layer = states_.layers.findUsed(id);
    return layer && layer->used && states_.autoReloads.covers(*layer);
}

void LayersState::setAutoReload(AutoReload kinds) {
    if (states_.autoReloads.setKinds(kinds)) states_.reloadAutomatically();
}

LayerResult<LayersState::Outcome> LayersState::addAutoReloadLayer(const std::string& id) {
    const auto* layer = states_.layers.findUsed(id);
    if (!layer) return tl::unexpected(*whyUnknown(id));
    if (!layer->used)
        return fail(LayerErrorType::NotFound, "the stage does not use the layer " + id + " now");
    if (!states_.autoReloads.add(layer->id)) return Outcome::Unchanged;
    states_.context.events.push({LayerEventType::AutoReloadLayersChanged, layer->id, {}, {}, {}});
    if (states_.files.isOutdated(*layer)) states_.reloadAutomatically();
    return Outcome::Changed;
}

LayersState::Outcome LayersState::removeAutoReloadLayer(const std::string& id) {
    const std::string& known = states_.layers.idOf(id);
    if (!states_.autoReloads.remove(known)) return Outcome::Unchanged;
    states_.context.events.push({LayerEventType::AutoReloadLayersChanged, known, {}, {}, {}});
    return Outcome::Changed;
}

std::vector<std::string> LayersState::autoReloadLayers() const {
    return states_.autoReloads.single();
}

}  // namespace usdlive::layers
