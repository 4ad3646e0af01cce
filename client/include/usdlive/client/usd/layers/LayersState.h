// The states of a stage's layers: dirty, locked, muted, outdated and writable.
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

#include "usdlive/client/usd/layers/LayerTypes.h"
#include "usdlive/client/usd/layers/LiveLayers.h"

namespace usdlive::layers {

class FileWatch;
struct LayersContext;

/// The states of a stage's layers, by identifier. Names are Kit's.
///
/// Queries use the state in memory and never read files; watch() does. For a layer that the stage
/// does not use they return false or nothing, and whyUnknown() gives the reason.
class LayersState {
public:
    explicit LayersState(LayersContext& context);
    ~LayersState();

    /// Returns the reason why the layer is unknown, or nothing if the stage uses it.
    [[nodiscard]] std::optional<LayerError> whyUnknown(const std::string& id);

    void setMutenessScope(bool global);
    [[nodiscard]] bool isMutenessGlobal() const { return globalScope_; }
    [[nodiscard]] bool isLayerLocallyMuted(const std::string& id);
    [[nodiscard]] bool isLayerGloballyMuted(const std::string& id);
    /// Returns the present state of the stage, whatever the scope.
    [[nodiscard]] bool isLayerMuted(const std::string& id);
    /// Writes the flag. In global scope the stage follows.
    LayerResult<void> setLayerGlobalMuteness(const std::string& id, bool muted);

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
    /// Returns true if the stage used the layer at the last check. Safe inside a notice, because it
    /// queries nothing.
    [[nodiscard]] bool knows(const std::string& id) const { return known_.contains(id); }

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

    // --- called by Layers

    /// Adopts the muteness of the stage. Changes by others become flags of the scope.
    void followMuteness();
    /// Does the same without writing. Safe inside a notice of the stage.
    void mutenessChanged();
    /// Call when sublayers or used layers may have changed.
    void structureChanged() { structureKnown_ = false; }
    /// Call after an edit that may change which layers are used. They are found again at the next
    /// query or check.
    void compositionChanged() { usedKnown_ = false; }
    /// Call when the customLayerData of the root layer or of a layer has changed.
    void dataChanged(const pxr::SdfLayerHandle& layer);
    void dirtinessChanged(const pxr::SdfLayerHandle& layer);
    /// Call after an edit of this process. A live layer is dirty from then on.
    void edited(const pxr::SdfLayerHandle& layer);
    /// Call when this process has written or read the layer's file, so that watch() does not report
    /// it.
    void fileAgrees(const pxr::SdfLayerHandle& layer);
    /// Checks the files of used layers, and which layers are used.
    void watch(double nowMs);
    /// Hides the delegate from the layers that users see.
    void hide(const std::string& identifier);

private:
    struct Known {
        pxr::SdfLayerHandle layer;
        bool local = false, session = false, used = false;
        bool ownLock = false;
        bool locked = false;  // last reported value
        bool outdated = false;
        bool readOnly = false;
        bool dirty = false;  // last reported value, for a live layer
        Revision saved = 0;
        // The value of `saved` at an edit of this process that the server's state does not show yet
        std::optional<Revision> editedAt;
        bool acknowledged = false;  // at the last check after this edit
        std::string owner;
    };

    [[nodiscard]] Known* find(const std::string& id);
    void learnStructure();
    void learnSublayers(const pxr::SdfLayerHandle& layer, bool session,
                        std::set<std::string>& visited);
    void learnUsed();
    void readFileState(Known& known);
    [[nodiscard]] std::optional<LiveState> liveState(const Known& known) const;
    [[nodiscard]] static bool isDirty(const Known& known, const LiveState& live);
    [[nodiscard]] static bool followDirtiness(Known& known, const LiveState& live);
    void followEdits();
    [[nodiscard]] bool writeLock(const std::string& id, const Known& known, bool locked);
    void learnFlags();
    void applyScope(const std::set<std::string>& wanted);
    [[nodiscard]] const std::set<std::string>& flagsOfScope() const;
    [[nodiscard]] bool isLocked(const std::string& id, const Known& known) const;
    [[nodiscard]] bool isAutoReloaded(const std::string& id, const Known& known) const;
    [[nodiscard]] bool isRoot(const std::string& id) const;
    [[nodiscard]] bool isSession(const std::string& id) const;
    bool reload(const std::vector<std::string>& ids);
    void reloadAutomatically();
    void look(double nowMs);
    void notifyLocks();

    LayersContext& context_;
    bool globalScope_ = false;
    std::set<std::string> localMuted_, globalMuted_, stageMuted_;
    std::map<std::string, bool> lockFlags_;  // the flags in the root layer's map
    std::unordered_map<std::string, Known> known_;
    std::vector<std::string> order_;  // local layers; the root layer's tree precedes the session's
    std::vector<std::string> invalid_;  // named as sublayers but missing
    std::set<std::string> used_;
    std::set<std::string> autoReload_;
    AutoReload autoReloadKinds_;
    std::string hidden_;
    bool structureKnown_ = false, usedKnown_ = false;
    std::map<std::string, bool> unwrittenFlags_;  // muteness flags to write in the next frame
    bool applying_ = false;                       // we are changing the stage
    bool scopeDue_ = false;                       // the stage has to adopt the global flags
    const std::unique_ptr<FileWatch> watch_;
    double nextLookMs_ = 0;
    std::set<std::string> edited_;  // the layers with `editedAt`
};

}  // namespace usdlive::layers
