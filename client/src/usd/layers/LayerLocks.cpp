// Reads and writes the locks of layers.
#include "usd/layers/LayerLocks.h"

#include <pxr/usd/sdf/changeBlock.h>

#include <utility>
#include <vector>

#include "usd/layers/LayersContext.h"
#include "usd/layers/OmniLayerData.h"

namespace usdlive::layers {

namespace {

const std::string kLocked = "locked";

}  // namespace

LayerLocks::LayerLocks(LayersContext& context, StageLayers& layers)
    : context_(context), layers_(layers) {
    learnFlags();
}

void LayerLocks::learnFlags() { flags_ = layerFlags(context_.host.rootLayer(), kLocked); }

bool LayerLocks::isFlagged(const std::string& id) const {
    const auto flag = flags_.find(id);
    return flag != flags_.end() && flag->second;
}

bool LayerLocks::isLocked(const StageLayers::Layer& layer) const {
    return layer.local && !layer.session && (own_.contains(layer.id) || isFlagged(layer.id)) &&
           !layers_.isRoot(layer.id);
}

LayerResult<void> LayerLocks::setLocked(const std::string& id, bool locked) {
    const auto* found = layers_.find(id);
    if (layers_.isRoot(id))
        return fail(LayerErrorType::InvalidParam, "the root layer cannot be locked");
    if (!found->local || found->session)
        return fail(LayerErrorType::InvalidParam,
                    id + " is not a sublayer of the stage, so it cannot be locked");
    if (const auto live = context_.liveState(found->layer); live && live->lockedByOther)
        return fail(LayerErrorType::ReadOnly,
                    id + " is locked by " + live->lockHolder.value +
                        ". Only they or an administrator of the server can unlock it");
    if (isLocked(*found) == locked) return {};
    const auto layer = found->layer;
    if (!write(id, *found, locked))
        return fail(LayerErrorType::ReadOnly,
                    id + " and the root layer do not both accept the edit of the lock");
    learnFlags();
    // Writing may have made the stage find its layers again.
    if ((found = layers_.find(id))) own_.assign(found->id, hasOwnLock(layer));
    notify();
    return {};
}

// Writes nothing and returns false if a lock would stay, or if there is no place for one.
bool LayerLocks::write(const std::string& id, const StageLayers::Layer& found, bool locked) {
    const auto layer = found.layer;
    const auto root = context_.host.rootLayer();
    const bool isLive = context_.liveState(layer).has_value();
    // A layer that is the root of another stage has that stage's map in the place of its own lock.
    // Then only our root layer stores the lock.
    const bool inLayer = layer && !omniValue(layer, kLocked).IsHolding<pxr::VtDictionary>() &&
                         (isLive || layer->PermissionToEdit());
    const auto map = omniValue(root, kLocked);
    const bool inRoot =
        root->PermissionToEdit() && (map.IsEmpty() || map.IsHolding<pxr::VtDictionary>());
    if (!inLayer && !inRoot) return false;
    if (!locked && ((own_.contains(found.id) && !inLayer) || (isFlagged(id) && !inRoot)))
        return false;
    const auto writeFlag = [&] {
        if (inRoot) setLayerFlags(root, kLocked, {{id, locked}});
    };
    if (inLayer && isLive) return context_.live->setLocked(layer, locked, writeFlag);
    const pxr::SdfChangeBlock block;
    if (inLayer) setOmniValue(layer, kLocked, pxr::VtValue(locked));
    writeFlag();
    return true;
}

void LayerLocks::layersFound() {
    own_.clear();
    reported_.clear();
    for (const auto& [id, layer] : layers_.allKnown()) {
        own_.assign(id, hasOwnLock(layer.layer));
        reported_.assign(id, isLocked(layer));
    }
}

void LayerLocks::dataChanged(const pxr::SdfLayerHandle& layer) {
    if (const auto* found = layers_.known(layer->GetIdentifier()))
        own_.assign(found->id, hasOwnLock(layer));
    if (layer == context_.host.rootLayer()) learnFlags();
    notify();
}

void LayerLocks::notify() {
    std::vector<std::string> changed;
    for (const auto& id : layers_.localKnown())
        if (reported_.assign(id, isLocked(*layers_.known(id)))) changed.push_back(id);
    if (!changed.empty())
        context_.events.push(LayerEventType::LockStateChanged, std::move(changed));
}

}  // namespace usdlive::layers
