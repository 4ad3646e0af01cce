#pragma once

#include <pxr/usd/sdf/changeList.h>
#include <pxr/usd/sdf/layer.h>

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "usdlive/client/usd/layers/LayersContext.h"

namespace usdlive::layers {

class DelegateWrites;
class DistributionRules;

/// Edits go to a delegate layer, the strongest sublayer of the session layer, and from there with
/// each update() to the layers where they have the strongest opinion; see Distribution for which.
class AutoAuthoring {
public:
    /// `rules` decide what takes edits; they must outlive this.
    AutoAuthoring(LayersContext& context, DistributionRules& rules);
    ~AutoAuthoring();

    [[nodiscard]] bool isEnabled() const { return bool(delegate_); }
    /// Where new specs go; the root layer at first. A layer that is not local, or of the session,
    /// is not taken.
    LayerResult<void> setDefaultLayer(const std::string& identifier);
    [[nodiscard]] std::string defaultLayer();
    [[nodiscard]] bool isAutoAuthoringLayer(const std::string& identifier) const;
    /// Edits stay in the delegate until resume().
    void suspend() { suspended_ = true; }
    void resume() { suspended_ = false; }
    [[nodiscard]] bool isSuspended() const { return suspended_; }

    // --- called by Layers

    /// Fails for a stage without a session layer, which is where the delegate goes.
    LayerResult<void> enable();
    /// What is in the delegate is distributed first; the default layer becomes the edit target.
    void disable();
    [[nodiscard]] pxr::SdfLayerHandle delegate() const { return delegate_; }
    void layerChanged(const pxr::SdfLayerHandle& layer, const pxr::SdfChangeList& changes);
    void structureChanged() { structureChanged_ = true; }
    /// One frame; within the caller's change block. Returns what went back.
    [[nodiscard]] std::vector<RefusedEdit> update();
    /// Puts delegate and edit target where they belong; before update(), and not in its block.
    void keepInPlace();

private:
    void followTime();
    void removeFromSession();

    LayersContext& context_;
    DistributionRules& rules_;
    pxr::SdfLayerRefPtr delegate_;
    pxr::TfRefPtr<DelegateWrites> writes_;
    pxr::SdfLayerHandle default_;
    std::map<pxr::SdfPath, bool> stale_;  // changed elsewhere; true: with all below
    bool suspended_ = false;
    bool structureChanged_ = false;
};

}  // namespace usdlive::layers
