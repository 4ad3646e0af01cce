// The layers that are reloaded automatically.
#pragma once

#include <set>
#include <string>
#include <utility>
#include <vector>

#include "usd/layers/StageLayers.h"
#include "usdlive/client/usd/layers/LayersState.h"

namespace usdlive::layers {

/// The choice of the layers that are reloaded automatically: single ones, and whole kinds. A value.
class AutoReloads {
public:
    /// Returns true if the layer is among the single ones, or of such a kind.
    [[nodiscard]] bool covers(const StageLayers::Layer& layer) const {
        return single_.contains(layer.id) || (layer.local ? kinds_.sublayers : kinds_.nonSublayers);
    }
    /// Returns true if this is a change.
    bool setKinds(LayersState::AutoReload kinds) { return std::exchange(kinds_, kinds) != kinds; }
    /// Returns false if it was added before.
    bool add(const std::string& id) { return single_.insert(id).second; }
    bool remove(const std::string& id) { return single_.erase(id) > 0; }
    [[nodiscard]] std::vector<std::string> single() const {
        return {single_.begin(), single_.end()};
    }

private:
    std::set<std::string> single_;
    LayersState::AutoReload kinds_;
};

}  // namespace usdlive::layers
