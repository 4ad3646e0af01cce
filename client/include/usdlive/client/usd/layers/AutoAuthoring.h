// The edit mode that distributes edits to the layers with the strongest opinions.
#pragma once

#include <pxr/usd/sdf/changeList.h>
#include <pxr/usd/sdf/layer.h>

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "usdlive/client/usd/layers/LayerTypes.h"

namespace usdlive::content {
class Recorder;
}

namespace usdlive::layers {

class DelegateWrites;
class DistributionRules;
struct LayersContext;

/// Collects edits in a delegate layer, the strongest sublayer of the session layer. Each update()
/// moves them to the layers with the strongest opinions; Distribution decides which.
class AutoAuthoring {
public:
    /// `rules` decide which layers and specs accept edits. They must outlive this object.
    AutoAuthoring(LayersContext& context, DistributionRules& rules);
    ~AutoAuthoring();

    [[nodiscard]] bool isEnabled() const { return bool(delegate_); }
    /// Sets the layer for new specs; initially the root layer. Fails for layers that are not local
    /// and for those of the session.
    LayerResult<void> setDefaultLayer(const std::string& identifier);
    [[nodiscard]] std::string defaultLayer();
    [[nodiscard]] bool isAutoAuthoringLayer(const std::string& identifier) const;
    /// Keeps edits in the delegate until resume().
    void suspend() { suspended_ = true; }
    void resume() { suspended_ = false; }
    [[nodiscard]] bool isSuspended() const { return suspended_; }

    // --- called by Layers

    /// Fails for a stage without a session layer, which has to contain the delegate.
    LayerResult<void> enable();
    /// Distributes the content of the delegate first. The default layer becomes the edit target.
    void disable();
    [[nodiscard]] pxr::SdfLayerHandle delegate() const { return delegate_; }
    void layerChanged(const pxr::SdfLayerHandle& layer, const pxr::SdfChangeList& changes);
    void structureChanged() { structureChanged_ = true; }
    /// Distributes the edits of one frame, within the caller's change block. Returns the refused
    /// edits. A `recorder` gets the edits of the layers instead of those of the delegate.
    [[nodiscard]] std::vector<RefusedEdit> update(content::Recorder* recorder = nullptr);
    /// Restores the place of the delegate and the edit target. Call it before update(), outside its
    /// block.
    void keepInPlace();

private:
    void followTime();
    void removeFromSession();

    LayersContext& context_;
    DistributionRules& rules_;
    pxr::SdfLayerRefPtr delegate_;
    pxr::TfRefPtr<DelegateWrites> writes_;
    pxr::SdfLayerHandle default_;
    std::map<pxr::SdfPath, bool> stale_;  // changed elsewhere; true: including everything below
    bool suspended_ = false;
    bool structureChanged_ = false;
    std::uint64_t stackRevision_ = 0;
};

}  // namespace usdlive::layers
