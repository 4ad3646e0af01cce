// Keeps which connection each live layer of this process belongs to.
#include "usd/LayerClaims.h"

#include <algorithm>

namespace usdlive::client {

LayerClaims& LayerClaims::ofProcess() {
    // Never destroyed: layers may be released while the process ends.
    static auto& claims = *new LayerClaims;
    return claims;
}

bool LayerClaims::claim(const pxr::SdfLayerHandle& layer, const void* owner) {
    const std::lock_guard lock(mutex_);
    if (entries_.size() >= forgetAt_) forgetExpired();
    Entry& entry = entries_[layer.GetUniqueIdentifier()];
    if (entry.owner && entry.owner != owner) return false;
    entry.layer = layer;
    entry.owner = owner;
    return true;
}

bool LayerClaims::isLiveElsewhere(const pxr::SdfLayerHandle& layer, const void* owner) const {
    const std::lock_guard lock(mutex_);
    const auto found = entries_.find(layer.GetUniqueIdentifier());
    return found != entries_.end() && found->second.owner && found->second.owner != owner;
}

void LayerClaims::release(const pxr::SdfLayerHandle& layer, const void* owner,
                          std::optional<LayerDoc> left) {
    const std::lock_guard lock(mutex_);
    const auto found = entries_.find(layer.GetUniqueIdentifier());
    if (found == entries_.end() || found->second.owner != owner) return;
    found->second.owner = nullptr;
    found->second.left = std::move(left);
}

std::optional<LayerDoc> LayerClaims::left(const pxr::SdfLayerHandle& layer) const {
    const std::lock_guard lock(mutex_);
    const auto found = entries_.find(layer.GetUniqueIdentifier());
    return found == entries_.end() ? std::nullopt : found->second.left;
}

// Called when the number of entries has doubled, so that claim() stays cheap.
void LayerClaims::forgetExpired() {
    std::erase_if(entries_, [](const auto& entry) { return entry.second.layer.IsExpired(); });
    forgetAt_ = std::max<std::size_t>(64, 2 * entries_.size());
}

}  // namespace usdlive::client
