// A layer stack composed by Pcp, used as a stage.
#include "usdlive/client/usd/layers/LayerStackHost.h"

#include <pxr/usd/pcp/layerStack.h>

#include "usd/stage/Composition.h"

namespace usdlive::layers {

LayerStackHost::LayerStackHost(pxr::SdfLayerRefPtr root, pxr::SdfLayerRefPtr session)
    : root_(std::move(root)), session_(std::move(session)), editTarget_(root_) {
    changedKey_ = pxr::TfNotice::Register(pxr::TfCreateWeakPtr(this), &LayerStackHost::onChanged);
}

LayerStackHost::~LayerStackHost() { pxr::TfNotice::Revoke(changedKey_); }

stage::Composition* LayerStackHost::composition() const {
    if (!composition_)
        composition_ = std::make_unique<stage::Composition>(root_, session_, mutedLayers(),
                                                            stage::Composition::Payloads::All);
    return composition_.get();
}

// Ignores notices from other threads: they concern layers that are not used here.
void LayerStackHost::onChanged(const pxr::SdfNotice::LayersDidChange& notice) {
    if (composition_ && std::this_thread::get_id() == thread_)
        composition_->follow(notice.GetChangeListVec());
}

std::vector<std::string> LayerStackHost::mutedLayers() const {
    return {muted_.begin(), muted_.end()};
}

void LayerStackHost::muteAndUnmute(const std::vector<std::string>& mute,
                                   const std::vector<std::string>& unmute) {
    for (const auto& layer : mute)
        if (layer != root_->GetIdentifier()) muted_.insert(layer);
    for (const auto& layer : unmute) muted_.erase(layer);
    if (composition_) composition_->setMuted(mutedLayers());
}

pxr::SdfLayerHandle LayerStackHost::editTarget() const {
    return editTarget_ ? editTarget_ : pxr::SdfLayerHandle(root_);
}

bool LayerStackHost::setEditTarget(const pxr::SdfLayerHandle& layer) {
    if (!layer || !composition()->localLayers().HasLayer(layer)) return false;
    editTarget_ = layer;
    return true;
}

std::vector<pxr::SdfLayerHandle> LayerStackHost::usedLayers() const {
    const auto used = composition()->usedLayers();
    return {used.begin(), used.end()};
}

std::vector<pxr::TfToken> LayerStackHost::childNames(const pxr::SdfPath& prim) const {
    return composition()->childNames(prim);
}

std::vector<pxr::TfToken> LayerStackHost::propertyNames(const pxr::SdfPath& prim) const {
    return composition()->propertyNames(prim);
}

}  // namespace usdlive::layers
