// The dirty layers of a stage.
#pragma once

#include <pxr/usd/sdf/layer.h>

#include <optional>
#include <set>
#include <string>
#include <unordered_map>

#include "usd/layers/StageLayers.h"
#include "usdlive/client/usd/layers/LiveLayers.h"
#include "usdlive/common/core/Id.h"

namespace usdlive::layers {

struct LayersContext;

/// Knows which layers are dirty, and reports when this changes. Sdf decides for a layer with a file
/// of its own, and the server for a live layer. Own edits of a live layer count at once, before the
/// server's state shows them.
class LayerDirtiness {
public:
    LayerDirtiness(LayersContext& context, StageLayers& layers);

    [[nodiscard]] bool isDirty(const StageLayers::Layer& layer) const;

    /// Starts with the state of a layer that was found. `live` is empty if it is not live.
    void add(const std::string& id, const std::optional<LiveState>& live);
    void remove(const std::string& id) { states_.erase(id); }

    /// Call when Sdf reports another dirtiness of the layer.
    void sdfReports(const pxr::SdfLayerHandle& layer);
    /// Call after an edit of this process. A live layer is dirty from then on.
    void edited(const pxr::SdfLayerHandle& layer);
    /// Follows the layers that this process has edited. Call it in every frame.
    void followEdits();
    /// Follows any live layer. Returns true if it became dirty or clean, or was saved, since the
    /// last call.
    [[nodiscard]] bool check(const std::string& id, const LiveState& live);

private:
    struct State {
        bool dirty = false;  // last reported value, for a live layer
        Revision saved = 0;
        // The value of `saved` at an edit of this process that the server's state does not show yet
        std::optional<Revision> editedAt;
        bool acknowledged = false;  // at the last check after this edit
    };

    [[nodiscard]] static bool isDirty(const State& state, const LiveState& live);
    [[nodiscard]] static bool follow(State& state, const LiveState& live);

    LayersContext& context_;
    StageLayers& layers_;
    std::unordered_map<std::string, State> states_;
    std::set<std::string> edited_;  // the layers with `editedAt`
};

}  // namespace usdlive::layers
