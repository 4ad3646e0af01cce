// The live layers of a client.
#pragma once

#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <vector>

#include "usd/live/LiveLayer.h"
#include "usd/live/LoadedLayers.h"

namespace usdlive::client {

/// The live layers of one client, and the active ones among them, for which a tick has work. The
/// cost of a tick depends on the active layers, not on the open ones.
class LiveSet {
public:
    using Layers = std::map<LayerId, std::unique_ptr<LiveLayer>>;

    [[nodiscard]] LiveLayer* find(const LayerId& id) const;
    [[nodiscard]] LiveLayer* find(const pxr::SdfLayerHandle& layer) const;
    [[nodiscard]] const Layers& all() const { return layers_; }
    /// Returns the layers for LoadedLayers.
    [[nodiscard]] const std::shared_ptr<const LoadedLayers::Known>& known();

    void add(std::unique_ptr<LiveLayer> layer);
    void remove(const LayerId& id);

    /// Call it from any thread when the layer is no longer LiveLayer::isIdle().
    void wake(const LayerId& id);
    /// Returns the layers that are not idle, sorted by id. Valid until a layer is added or removed.
    [[nodiscard]] std::vector<LiveLayer*> active();

private:
    Layers layers_;
    std::map<const void*, LiveLayer*> bySdfLayer_;
    std::shared_ptr<const LoadedLayers::Known> known_;  // created when it is requested
    std::set<LayerId> active_;
    std::mutex mutex_;  // guards woken_
    std::vector<LayerId> woken_;
};

}  // namespace usdlive::client
