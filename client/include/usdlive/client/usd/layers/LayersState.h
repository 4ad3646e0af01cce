// The states of a stage's layers: dirty, locked, muted, outdated and writable.
#pragma once

#include <pxr/usd/sdf/layer.h>

#include <optional>
#include <string>
#include <vector>

#include "usdlive/client/usd/layers/LayerTypes.h"

namespace usdlive::layers {

struct StageLayerStates;

/// The states of a stage's layers, by identifier. Names are Kit's. Part of a Layers, which returns
/// it; Layers::update() keeps it up to date.
///
/// Queries use the state in memory and never read files; Layers::update() does. For a layer that
/// the stage does not use they return false or nothing, and whyUnknown() gives the reason.
class LayersState {
public:
    LayersState(const LayersState&) = delete;
    LayersState& operator=(const LayersState&) = delete;

    /// Returns the reason why the layer is unknown, or nothing if the stage uses it.
    [[nodiscard]] std::optional<LayerError> whyUnknown(const std::string& id);

    void setMutenessScope(bool global);
    [[nodiscard]] bool isMutenessGlobal() const;
    [[nodiscard]] bool isLayerLocallyMuted(const std::string& id);
    [[nodiscard]] bool isLayerGloballyMuted(const std::string& id);
    /// Returns the present state of the stage, whatever the scope.
    [[nodiscard]] bool isLayerMuted(const std::string& id);
    /// Writes the flag. In global scope the stage follows.
    LayerResult<void> setLayerGlobalMuteness(const std::string& id, bool muted);
    /// Call when the stage has muted or unmuted layers, so that queries and events follow at once.
    /// Otherwise they follow with the next Layers::update(). Writes nothing, so it is safe inside a
    /// notice of the stage.
    void mutenessChanged();

    [[nodiscard]] bool isLayerWritable(const std::string& id);
    [[nodiscard]] bool isLayerReadonlyOnDisk(const std::string& id);
    [[nodiscard]] bool isLayerSavable(const std::string& id);
    [[nodiscard]] bool isLayerDirty(const std::string& id);

    /// Writes the lock into the layer and into the root layer's map, both or none. Fails for a live
    /// layer that somebody else has locked.
    LayerResult<void> setLayerLockState(const std::string& id, bool locked);
    [[nodiscard]] bool isLayerLocked(const std::string& id);

    LayerResult<void> setLayerName(const std::string& id, const std::string& name);
    [[nodiscard]] std::string layerName(const std::string& id);
    [[nodiscard]] std::string layerOwner(const std::string& id);

    [[nodiscard]] bool isLayerOutdated(const std::string& id);
    [[nodiscard]] std::vector<std::string> localLayerIdentifiers(bool session, bool anonymous,
                                                                 bool invalid);
    [[nodiscard]] std::vector<std::string> dirtyLayerIdentifiers();
    enum class Which { All, Sublayers, NonSublayers };
    [[nodiscard]] std::vector<std::string> outdatedLayerIdentifiers(Which which, bool notAuto);
    LayerResult<void> reloadOutdatedLayers(Which which, bool notAuto);

    [[nodiscard]] bool hasLocalLayer(const std::string& id);
    [[nodiscard]] bool hasUsedLayer(const std::string& id);

    /// The kinds of layers that are reloaded automatically, in addition to single layers.
    struct AutoReload {
        bool sublayers = false;     ///< all layers of the local layer stack
        bool nonSublayers = false;  ///< all other layers that the stage uses
        bool operator==(const AutoReload&) const = default;
    };
    void setAutoReload(AutoReload kinds);
    /// Returns true if the layer is reloaded automatically, individually or because of its kind.
    [[nodiscard]] bool isAutoReloadLayer(const std::string& id);
    enum class Outcome { Changed, Unchanged };
    LayerResult<Outcome> addAutoReloadLayer(const std::string& id);
    Outcome removeAutoReloadLayer(const std::string& id);
    /// Returns the layers that were added individually.
    [[nodiscard]] std::vector<std::string> autoReloadLayers() const;

    /// Returns the reason why the layer must not be edited, or nothing if it may.
    [[nodiscard]] std::optional<LayerError> whyNotWritable(const pxr::SdfLayerHandle& layer);

private:
    friend class Layers;
    explicit LayersState(StageLayerStates& states) : states_(states) {}

    StageLayerStates& states_;
};

}  // namespace usdlive::layers
