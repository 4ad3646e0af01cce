// The delegate layer of auto authoring.
#pragma once

#include <pxr/usd/sdf/changeList.h>
#include <pxr/usd/sdf/layer.h>

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "usd/layers/DelegateWrites.h"
#include "usdlive/client/usd/layers/LayerTypes.h"

namespace usdlive::content {
class Recorder;
}

namespace usdlive::layers {

class Distribution;
class DistributionRules;
struct LayersContext;

/// Keeps the delegate layer in its place, and moves its edits to the layers where they belong;
/// Distribution decides which. AutoAuthoring shows it to users and says what the functions do.
class DelegateAuthoring {
public:
    /// `rules` decide which layers and specs accept edits. They must outlive this object.
    DelegateAuthoring(LayersContext& context, DistributionRules& rules);
    ~DelegateAuthoring();
    DelegateAuthoring(const DelegateAuthoring&) = delete;
    DelegateAuthoring& operator=(const DelegateAuthoring&) = delete;

    LayerResult<void> setDefaultLayer(const std::string& identifier);
    [[nodiscard]] std::string defaultLayer();
    [[nodiscard]] static bool isDelegate(const std::string& identifier);
    void suspend() { suspended_ = true; }
    void resume() { suspended_ = false; }
    [[nodiscard]] bool isSuspended() const { return suspended_; }

    /// Fails for a stage without a session layer, which has to contain the delegate.
    LayerResult<void> enable();
    /// Call it after the content of the delegate was distributed. The default layer becomes the
    /// edit target.
    void disable();
    /// Returns null if auto authoring is not enabled.
    [[nodiscard]] pxr::SdfLayerHandle delegate() const { return delegate_; }
    [[nodiscard]] const pxr::TfRefPtr<DelegateWrites>& writes() const { return writes_; }
    /// Returns a distribution with the present layers. New specs have no layer in it.
    [[nodiscard]] Distribution distribution() const;

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
