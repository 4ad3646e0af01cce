// Keeps which connection each live layer of this process belongs to.
#include "usd/live/LayerClaims.h"

#include <pthread.h>

#include <algorithm>
#include <utility>

namespace usdlive::client {

LayerClaims& LayerClaims::ofProcess() {
    // Never destroyed: layers may be released while the process ends.
    static auto& claims = *new LayerClaims;
    return claims;
}

// The handlers of fork() hold the mutex, so that the new process finds the entries complete.
LayerClaims::LayerClaims() {
    ::pthread_atfork([] { ofProcess().mutex_.lock(); }, [] { ofProcess().mutex_.unlock(); },
                     [] {
                         ofProcess().closeAll();
                         ofProcess().mutex_.unlock();
                     });
}

// Only sets flags: after fork(), a function that allocates memory might wait for ever.
void LayerClaims::closeAll() {
    for (auto& [key, entry] : entries_)
        if (entry.owner && entry.layer) entry.layer->SetPermissionToEdit(false);
}

bool LayerClaims::claim(const pxr::SdfLayerHandle& layer, const void* owner) {
    const std::lock_guard lock(mutex_);
    Entry& entry = entryOf(layer);
    if (entry.owner && entry.owner != owner) return false;
    entry.owner = owner;
    if (std::exchange(entry.isClosed, false)) layer->SetPermissionToEdit(true);
    return true;
}

void LayerClaims::close(const pxr::SdfLayerHandle& layer) {
    const std::lock_guard lock(mutex_);
    Entry& entry = entryOf(layer);
    // A muted layer never permits edits, so the editor's own setting is unknown.
    const bool permits = layer->IsMuted() || layer->PermissionToEdit();
    if (entry.owner || entry.isClosed || !permits) return;
    layer->SetPermissionToEdit(false);
    entry.isClosed = true;
}

void LayerClaims::open(const pxr::SdfLayerHandle& layer) {
    const std::lock_guard lock(mutex_);
    if (std::exchange(entryOf(layer).isClosed, false)) layer->SetPermissionToEdit(true);
}

LayerClaims::Entry& LayerClaims::entryOf(const pxr::SdfLayerHandle& layer) {
    if (entries_.size() >= forgetAt_) forgetExpired();
    Entry& entry = entries_[layer.GetUniqueIdentifier()];
    entry.layer = layer;
    return entry;
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

// Called when the number of entries has doubled, so that entryOf() stays cheap.
void LayerClaims::forgetExpired() {
    std::erase_if(entries_, [](const auto& entry) { return entry.second.layer.IsExpired(); });
    forgetAt_ = std::max<std::size_t>(64, 2 * entries_.size());
}

}  // namespace usdlive::client
