// Keeps the live layers of a client.
#include "usd/live/LiveSet.h"

#include <iterator>

namespace usdlive::client {

LiveLayer* LiveSet::find(const LayerId& id) const {
    const auto found = layers_.find(id);
    return found == layers_.end() ? nullptr : found->second.get();
}

LiveLayer* LiveSet::find(const pxr::SdfLayerHandle& layer) const {
    const auto found = bySdfLayer_.find(layer.GetUniqueIdentifier());
    return found == bySdfLayer_.end() ? nullptr : found->second;
}

const std::shared_ptr<const LoadedLayers::Known>& LiveSet::known() {
    if (known_) return known_;
    auto known = std::make_shared<LoadedLayers::Known>();
    for (const auto& [layer, live] : bySdfLayer_) known->insert(layer);
    known_ = std::move(known);
    return known_;
}

void LiveSet::add(std::unique_ptr<LiveLayer> layer) {
    known_.reset();
    bySdfLayer_[pxr::SdfLayerHandle(layer->layer()).GetUniqueIdentifier()] = layer.get();
    wake(layer->id());
    layers_[layer->id()] = std::move(layer);
}

void LiveSet::remove(const LayerId& id) {
    const auto found = layers_.find(id);
    if (found == layers_.end()) return;
    known_.reset();
    bySdfLayer_.erase(pxr::SdfLayerHandle(found->second->layer()).GetUniqueIdentifier());
    layers_.erase(found);
}

void LiveSet::wake(const LayerId& id) {
    const std::lock_guard lock(mutex_);
    woken_.push_back(id);
}

std::vector<LiveLayer*> LiveSet::active() {
    {
        const std::lock_guard lock(mutex_);
        active_.insert(std::make_move_iterator(woken_.begin()),
                       std::make_move_iterator(woken_.end()));
        woken_.clear();
    }
    std::vector<LiveLayer*> active;
    std::erase_if(active_, [&](const LayerId& id) {
        LiveLayer* live = find(id);
        if (!live || live->isIdle()) return true;
        active.push_back(live);
        return false;
    });
    return active;
}

}  // namespace usdlive::client
