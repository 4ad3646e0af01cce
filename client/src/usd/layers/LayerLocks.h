// The locks of a stage's layers.
#pragma once

#include <pxr/usd/sdf/layer.h>

#include <map>
#include <string>

#include "usd/layers/LayerIdSet.h"
#include "usd/layers/StageLayers.h"
#include "usdlive/client/usd/layers/LayerTypes.h"

namespace usdlive::layers {

struct LayersContext;

/// Knows which local layers are locked: by their own data, or by a flag in the root layer's map.
/// The root layer and the session's layers are never locked.
class LayerLocks {
public:
    LayerLocks(LayersContext& context, StageLayers& layers);

    [[nodiscard]] bool isLocked(const StageLayers::Layer& layer) const;
    /// Writes the lock into the layer and into the root layer's map. The stage must use the layer.
    LayerResult<void> setLocked(const std::string& id, bool locked);

    /// Call when other layers were found. Reports nothing: a lock that came with its layer is not
    /// news.
    void layersFound();
    /// Call when the customLayerData of the layer has changed.
    void dataChanged(const pxr::SdfLayerHandle& layer);

private:
    void learnFlags();
    [[nodiscard]] bool isFlagged(const std::string& id) const;
    [[nodiscard]] bool write(const std::string& id, const StageLayers::Layer& layer, bool locked);
    void notify();

    LayersContext& context_;
    StageLayers& layers_;
    std::map<std::string, bool> flags_;  // the root layer's map
    LayerIdSet own_;                     // locked by their own data
    LayerIdSet reported_;                // locked at the last notify()
};

}  // namespace usdlive::layers
