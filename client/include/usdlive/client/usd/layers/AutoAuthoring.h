// The edit mode that distributes edits to the layers with the strongest opinions.
#pragma once

#include <pxr/usd/sdf/changeList.h>
#include <pxr/usd/sdf/layer.h>

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
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
    friend class Clearing;
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

/// Lets functions that clear or remove opinions work in the modes with a delegate.
///
/// UsdAttribute::Clear(), UsdObject::ClearMetadata(), UsdPrim::RemoveProperty() and the like only
/// look into the edit target, which is the delegate, and that mirrors only what was edited. While
/// this object lives, the delegate has opinions for all fields of the specs that a layer has
/// opinions for. Those that are cleared meanwhile are distributed like other edits: the strongest
/// opinion is cleared. Lists that are edited meanwhile (UsdReferences::AddReference) are edited as
/// in the layer itself, with its positions. Contains a change block. Does nothing in the normal
/// mode. Make one with the path of the attribute before attribute.Clear().
class Clearing {
public:
    /// `specs` are paths of the edit target. With `time`, only the samples at this time can be
    /// cleared (UsdAttribute::ClearAtTime), whose cost does not depend on the other samples.
    Clearing(AutoAuthoring& authoring, const std::vector<pxr::SdfPath>& specs,
             std::optional<double> time = std::nullopt);
    ~Clearing();
    Clearing(const Clearing&) = delete;
    Clearing& operator=(const Clearing&) = delete;

private:
    class Impl;
    std::unique_ptr<Impl> impl_;
};

}  // namespace usdlive::layers
