#pragma once

#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <vector>

#include "usd/LiveLayer.h"
#include "usd/LoadedLayers.h"

namespace usdlive::client {

/// The live layers of one client, and which of them have something for a tick to do: a tick costs
/// what is active, not what is open.
class LiveSet {
public:
    using Layers = std::map<LayerId, std::unique_ptr<LiveLayer>>;

    [[nodiscard]] LiveLayer* find(const LayerId& id) const;
    [[nodiscard]] LiveLayer* find(const pxr::SdfLayerHandle& layer) const;
    [[nodiscard]] const Layers& all() const { return layers_; }
    /// For LoadedLayers.
    [[nodiscard]] const std::shared_ptr<const LoadedLayers::Known>& known();

    void add(std::unique_ptr<LiveLayer> layer);
    void remove(const LayerId& id);

    /// Any thread: the layer is not LiveLayer::isIdle() any more.
    void wake(const LayerId& id);
    /// Those that are not idle, by id. Valid until one is added or removed.
    [[nodiscard]] std::vector<LiveLayer*> active();

private:
    Layers layers_;
    std::map<const void*, LiveLayer*> bySdfLayer_;
    std::shared_ptr<const LoadedLayers::Known> known_;  // made when it is asked for
    std::set<LayerId> active_;
    std::mutex mutex_;  // guards woken_
    std::vector<LayerId> woken_;
};

}  // namespace usdlive::client
