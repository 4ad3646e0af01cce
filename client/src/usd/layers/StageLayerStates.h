// The parts of the states of a stage's layers.
#pragma once

#include <pxr/usd/sdf/layer.h>

#include <string>
#include <vector>

#include "usd/layers/AutoReloads.h"
#include "usd/layers/LayerDirtiness.h"
#include "usd/layers/LayerFileStates.h"
#include "usd/layers/LayerLocks.h"
#include "usd/layers/LayerMuteness.h"
#include "usd/layers/StageLayers.h"

namespace usdlive::layers {

struct LayersContext;

/// The states of a stage's layers: creates the parts and connects them. LayersState shows them to
/// users. Layers calls the functions here when something has changed, and in each frame.
struct StageLayerStates {
    explicit StageLayerStates(LayersContext& layersContext);
    StageLayerStates(const StageLayerStates&) = delete;
    StageLayerStates& operator=(const StageLayerStates&) = delete;

    /// Call when the customLayerData of the root layer or of a layer has changed.
    void dataChanged(const pxr::SdfLayerHandle& layer);
    /// Follows changes on the stage, and checks files and used layers now and then.
    void watch(double nowMs);
    /// Reloads live layers that are outdated and covered by `autoReloads`. Files are reloaded with
    /// the next check, which follows soon.
    void reloadAutomatically();

    LayersContext& context;
    LayerMuteness muteness;
    StageLayers layers;
    LayerLocks locks;
    LayerDirtiness dirtiness;
    LayerFileStates files;
    AutoReloads autoReloads;

private:
    void found(const StageLayers::Difference& difference);
    void check();
    void notify(LayerEventType type, std::vector<std::string> ids);

    double nextCheckMs_ = 0;
};

}  // namespace usdlive::layers
