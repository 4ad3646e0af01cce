// Answers the layers API from a stage::Stage.
#include "usdlive/client/usd/layers/ComposedStageHost.h"

#include <set>

#include "usd/stage/Composition.h"
#include "usdlive/client/usd/stage/Stage.h"

namespace usdlive::layers {

pxr::SdfLayerHandle ComposedStageHost::rootLayer() const { return stage_.rootLayer(); }

pxr::SdfLayerHandle ComposedStageHost::sessionLayer() const { return stage_.sessionLayer(); }

std::vector<std::string> ComposedStageHost::mutedLayers() const { return stage_.mutedLayers(); }

void ComposedStageHost::muteAndUnmute(const std::vector<std::string>& mute,
                                      const std::vector<std::string>& unmute) {
    const auto& before = stage_.mutedLayers();
    std::set<std::string> muted(before.begin(), before.end());
    muted.insert(mute.begin(), mute.end());
    muted.erase(stage_.rootLayer()->GetIdentifier());
    for (const auto& layer : unmute) muted.erase(layer);
    stage_.setMutedLayers({muted.begin(), muted.end()});
}

pxr::SdfLayerHandle ComposedStageHost::editTarget() const {
    const auto& layer = stage_.editTarget().layer();
    return layer ? layer : stage_.rootLayer();
}

bool ComposedStageHost::setEditTarget(const pxr::SdfLayerHandle& layer) {
    if (!layer || !stage_.hasLocalLayer(layer)) return false;
    stage_.setEditTarget(stage_.editTargetFor(layer));
    return true;
}

std::vector<pxr::SdfLayerHandle> ComposedStageHost::usedLayers() const {
    const auto used = stage_.usedLayers();
    return {used.begin(), used.end()};
}

std::vector<pxr::TfToken> ComposedStageHost::childNames(const pxr::SdfPath& prim) const {
    return stage_.composition().childNames(prim);
}

std::vector<pxr::TfToken> ComposedStageHost::propertyNames(const pxr::SdfPath& prim) const {
    return stage_.composition().propertyNames(prim);
}

stage::Composition* ComposedStageHost::composition() const { return &stage_.composition(); }

}  // namespace usdlive::layers
