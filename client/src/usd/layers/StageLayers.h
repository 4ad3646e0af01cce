// The layers that a stage uses.
#pragma once

#include <pxr/usd/sdf/layer.h>

#include <cstdint>
#include <functional>
#include <optional>
#include <set>
#include <string>
#include <unordered_map>
#include <vector>

#include "usdlive/client/usd/layers/LayerTypes.h"

namespace usdlive::layers {

class LayerMuteness;
struct LayersContext;

/// Knows which layers a stage uses: those of the local layer stack, in order, and those that other
/// arcs name. Finds them again at the first query after they may have changed, and then calls
/// `found`.
class StageLayers {
public:
    struct Layer {
        std::string id;
        pxr::SdfLayerHandle layer;  ///< null if it is muted and not loaded
        bool local = false;         ///< in the local layer stack
        bool session = false;       ///< the session layer, or local and below it
        bool used = false;          ///< contributes to the stage
    };
    using ById = std::unordered_map<std::string, Layer>;

    /// The difference to the layers that were known before.
    struct Difference {
        std::vector<const Layer*> added;
        std::vector<std::string> removed;
    };
    /// Called each time after the layers were found. May use the functions `...Known` only.
    using Found = std::function<void(const Difference&)>;

    StageLayers(LayersContext& context, const LayerMuteness& muteness, Found found);

    /// Returns null if the stage does not use the layer. Also finds it by another spelling of its
    /// identifier.
    [[nodiscard]] const Layer* find(const std::string& id);
    /// Does the same after checking which layers the stage uses, if an edit may have changed that.
    [[nodiscard]] const Layer* findUsed(const std::string& id);
    /// Returns the identifier of the layer that was last found for this spelling of it, or else the
    /// spelling itself. Safe inside a notice. Valid until the layers are found again.
    [[nodiscard]] const std::string& idOf(const std::string& spelling) const;
    /// Returns the layer as it was last found. Safe inside a notice, because it queries nothing.
    [[nodiscard]] const Layer* known(const std::string& id) const;
    [[nodiscard]] std::optional<LayerError> whyUnknown(const std::string& id);
    [[nodiscard]] bool isRoot(const std::string& id) const;
    [[nodiscard]] bool isSession(const std::string& id) const;

    /// Returns the identifiers of the local layers. The root layer's tree precedes the session's.
    [[nodiscard]] const std::vector<std::string>& local();
    /// Returns the identifiers that are named as sublayers but are missing.
    [[nodiscard]] const std::vector<std::string>& missing();
    /// Returns the identifiers of the layers that contribute to the stage.
    [[nodiscard]] const std::set<std::string>& used();
    /// Returns all layers as they were last found.
    [[nodiscard]] const ById& allKnown() const { return layers_; }
    [[nodiscard]] const std::vector<std::string>& localKnown() const { return order_; }

    /// Call when sublayers may have changed.
    void structureChanged() { structureKnown_ = false; }
    /// Call after an edit that may change which layers are used.
    void compositionChanged() { usedKnown_ = false; }
    /// Leaves the layer out: the delegate of auto authoring.
    void hide(const std::string& identifier);
    /// Finds the layers now, and reports it if others are used.
    void check();

private:
    [[nodiscard]] bool isCurrent() const;
    void learn();
    void learnLocal();
    void learnSublayers(const pxr::SdfLayerHandle& layer, bool session,
                        std::set<std::string>& visited);
    void addLocal(const std::string& id, const pxr::SdfLayerHandle& layer, bool session);
    void keepCurrent();

    LayersContext& context_;
    const LayerMuteness& muteness_;
    const Found found_;
    ById layers_;
    std::vector<std::string> order_;
    std::vector<std::string> missing_;
    std::set<std::string> used_;
    std::string hidden_;
    bool structureKnown_ = false, usedKnown_ = false;
    std::uint64_t mutenessKnown_ = 0;  // the revision of the muteness that layers_ belongs to
};

}  // namespace usdlive::layers
