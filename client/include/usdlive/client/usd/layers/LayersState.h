#pragma once

#include <pxr/usd/sdf/layer.h>

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "usdlive/client/usd/layers/FileWatch.h"
#include "usdlive/client/usd/layers/LayersContext.h"

namespace usdlive::layers {

/// States of the layers of a stage, by identifier. Names are Kit's.
///
/// Queries look at what is in memory, never at files; files are looked at by watch(). Of a layer
/// that the stage does not use they say false or nothing; whyUnknown() tells that apart.
class LayersState {
public:
    explicit LayersState(LayersContext& context);
    ~LayersState();

    /// Why queries know nothing of the layer. Nothing: the stage uses it.
    [[nodiscard]] std::optional<LayerError> whyUnknown(const std::string& id);

    void setMutenessScope(bool global);
    [[nodiscard]] bool isMutenessGlobal() const { return globalScope_; }
    [[nodiscard]] bool isLayerLocallyMuted(const std::string& id);
    [[nodiscard]] bool isLayerGloballyMuted(const std::string& id);
    /// As the stage is now, whatever the scope.
    [[nodiscard]] bool isLayerMuted(const std::string& id);
    /// Writes the flag; in global scope the stage follows.
    LayerResult<void> setLayerGlobalMuteness(const std::string& id, bool muted);

    [[nodiscard]] bool isLayerWritable(const std::string& id);
    [[nodiscard]] bool isLayerReadonlyOnDisk(const std::string& id);
    [[nodiscard]] bool isLayerSavable(const std::string& id);
    [[nodiscard]] bool isLayerDirty(const std::string& id);

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
    /// A layer that the stage used when it was last asked. Asks nobody: safe within a notice.
    [[nodiscard]] bool knows(const std::string& id) const { return known_.contains(id); }

    /// Beside single layers: what is reloaded by itself when it is outdated.
    struct AutoReload {
        bool sublayers = false;     ///< all of the local layer stack
        bool nonSublayers = false;  ///< all others that the stage uses
        bool operator==(const AutoReload&) const = default;
    };
    void setAutoReload(AutoReload kinds);
    /// By itself or by its kind.
    [[nodiscard]] bool isAutoReloadLayer(const std::string& id);
    enum class Outcome { Changed, Unchanged };
    LayerResult<Outcome> addAutoReloadLayer(const std::string& id);
    Outcome removeAutoReloadLayer(const std::string& id);
    /// The single ones.
    [[nodiscard]] std::vector<std::string> autoReloadLayers() const;

    /// Why edits must not go there; nothing: they may.
    [[nodiscard]] std::optional<LayerError> whyNotWritable(const pxr::SdfLayerHandle& layer);

    // --- called by Layers

    /// Muteness as the stage has it now; what others changed becomes flags of the scope.
    void followMuteness();
    /// The same without writing anything: safe within a notice of the stage.
    void mutenessChanged();
    /// Sublayers or used layers may have changed.
    void structureChanged() { structureKnown_ = false; }
    /// Something was authored that other layers may be used for: they are looked up when asked for,
    /// and with the next look.
    void compositionChanged() { usedKnown_ = false; }
    /// The root layer's or a layer's own customLayerData has changed.
    void dataChanged(const pxr::SdfLayerHandle& layer);
    void dirtinessChanged(const pxr::SdfLayerHandle& layer);
    /// The layer's file was written or read by this process: it is no news to watch().
    void fileAgrees(const pxr::SdfLayerHandle& layer);
    /// Looks at the files of used layers, and at used layers themselves.
    void watch(double nowMs);
    /// The delegate is not one of the stage's layers as people see them.
    void hide(const std::string& identifier);

private:
    struct Known {
        pxr::SdfLayerHandle layer;
        bool local = false, session = false, used = false;
        bool ownLock = false;
        bool locked = false;  // as last told
        bool outdated = false;
        bool readOnly = false;
        bool dirty = false;  // of a live layer, as last told
        std::string owner;
    };

    [[nodiscard]] Known* find(const std::string& id);
    void learnStructure();
    void learnSublayers(const pxr::SdfLayerHandle& layer, bool session,
                        std::set<std::string>& visited);
    void learnUsed();
    void readFileState(Known& known);
    void learnFlags();
    void applyScope(const std::set<std::string>& wanted);
    [[nodiscard]] const std::set<std::string>& flagsOfScope() const;
    [[nodiscard]] bool isLocked(const std::string& id, const Known& known) const;
    [[nodiscard]] bool reloadsItself(const std::string& id, const Known& known) const;
    [[nodiscard]] bool isRoot(const std::string& id) const;
    [[nodiscard]] bool isSession(const std::string& id) const;
    bool reload(const std::vector<std::string>& ids);
    void reloadWhatReloadsItself();
    void look(double nowMs);
    void tellLocks();

    LayersContext& context_;
    bool globalScope_ = false;
    std::set<std::string> localMuted_, globalMuted_, stageMuted_;
    std::map<std::string, bool> lockFlags_;  // of the root layer's map
    std::unordered_map<std::string, Known> known_;
    std::vector<std::string> order_;    // local layers, the root layer's tree before the session's
    std::vector<std::string> invalid_;  // named as sublayers, and not there
    std::set<std::string> used_;
    std::set<std::string> autoReload_;
    AutoReload autoReloadKinds_;
    std::string hidden_;
    bool structureKnown_ = false, usedKnown_ = false;
    std::map<std::string, bool> unwrittenFlags_;  // of muteness, for the next frame
    bool applying_ = false;                       // the stage is changed by us
    bool scopeDue_ = false;                       // the stage has to follow the global flags
    FileWatch watch_;
    double nextLookMs_ = 0;
};

}  // namespace usdlive::layers
