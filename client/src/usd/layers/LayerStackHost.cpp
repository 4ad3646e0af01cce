#include "usdlive/client/usd/layers/LayerStackHost.h"

namespace usdlive::layers {

LayerStackHost::LayerStackHost(pxr::SdfLayerRefPtr root, pxr::SdfLayerRefPtr session)
    : root_(std::move(root)), session_(std::move(session)), editTarget_(root_) {}

std::vector<std::string> LayerStackHost::mutedLayers() const {
    return {muted_.begin(), muted_.end()};
}

void LayerStackHost::muteAndUnmute(const std::vector<std::string>& mute,
                                   const std::vector<std::string>& unmute) {
    for (const auto& layer : mute)
        if (layer != root_->GetIdentifier()) muted_.insert(layer);
    for (const auto& layer : unmute) muted_.erase(layer);
}

pxr::SdfLayerHandle LayerStackHost::editTarget() const {
    return editTarget_ ? editTarget_ : pxr::SdfLayerHandle(root_);
}

bool LayerStackHost::setEditTarget(const pxr::SdfLayerHandle& layer) {
    if (!layer || !composed().find(layer)) return false;
    editTarget_ = layer;
    return true;
}

std::vector<pxr::SdfLayerHandle> LayerStackHost::usedLayers() const {
    const auto used = composed().usedLayers();
    return {used.begin(), used.end()};
}

std::vector<pxr::TfToken> LayerStackHost::childNames(const pxr::SdfPath& prim) const {
    return composed().childNames(prim);
}

std::vector<pxr::TfToken> LayerStackHost::propertyNames(const pxr::SdfPath& prim) const {
    return composed().propertyNames(prim);
}

}  // namespace usdlive::layers
