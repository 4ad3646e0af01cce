// The edit mode that distributes edits to the layers with the strongest opinions.
#pragma once

#include <pxr/usd/sdf/path.h>

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "usdlive/client/usd/layers/LayerTypes.h"

namespace usdlive::layers {

class DelegateAuthoring;

/// Collects edits in a delegate layer, the strongest sublayer of the session layer and the edit
/// target. Each Layers::update() moves them to the layers with the strongest opinions. Part of a
/// Layers, which returns it; Layers::setEditMode() enables it.
class AutoAuthoring {
public:
    AutoAuthoring(const AutoAuthoring&) = delete;
    AutoAuthoring& operator=(const AutoAuthoring&) = delete;

    [[nodiscard]] bool isEnabled() const;
    /// Sets the layer for new specs; initially the root layer. Fails for layers that are not local
    /// and for those of the session.
    LayerResult<void> setDefaultLayer(const std::string& identifier);
    [[nodiscard]] std::string defaultLayer();
    /// Returns true for the identifier of a delegate layer.
    [[nodiscard]] bool isAutoAuthoringLayer(const std::string& identifier) const;
    /// Keeps edits in the delegate until resume().
    void suspend();
    void resume();
    [[nodiscard]] bool isSuspended() const;

private:
    friend class Layers;
    friend class Clearing;
    explicit AutoAuthoring(DelegateAuthoring& authoring) : authoring_(authoring) {}

    DelegateAuthoring& authoring_;
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
