// The local layers of a stage and the places with opinions about a prim.
#pragma once

#include <pxr/usd/sdf/changeList.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/layerOffset.h>

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "usd/stage/Composition.h"
#include "usdlive/client/usd/layers/LayerTypes.h"
#include "usdlive/client/usd/layers/StageHost.h"

namespace usdlive::layers {

/// A stage's local layer stack and the composition above it. Answers come from the host's
/// Composition. If the host composes elsewhere, this creates one of its own when it is first
/// needed, without payloads, because the stage decides which to load.
class LocalStack {
public:
    struct Layer {
        pxr::SdfLayerHandle layer;
        pxr::SdfLayerOffset toStack;  ///< from the layer's time to the stage's time
        bool ofSession = false;
    };

    explicit LocalStack(const StageHost& host);

    /// Call for each SdfNotice::LayersDidChange.
    void follow(const pxr::SdfLayerChangeListVec& changes);
    /// Call when the host's muted layers have changed.
    void mutenessChanged();

    /// Strong to weak.
    [[nodiscard]] const std::vector<Layer>& layers();
    [[nodiscard]] const Layer* find(const pxr::SdfLayerHandle& layer);
    /// Finds the layer by its identifier, or by a path as the root layer would write it.
    [[nodiscard]] LayerResult<Layer> named(const std::string& identifier);
    [[nodiscard]] double timeCodesPerSecond();
    /// Changes with layers(): by mutes, sublayers, their offsets and expressions.
    [[nodiscard]] std::uint64_t revision();

    /// A place with opinions about the composed prim.
    struct Site {
        pxr::SdfPath path;
        /// Null: the prim itself or one of its selected variants, in layers(). Otherwise the layer
        /// stack of another arc.
        const pxr::PcpLayerStack* foreign = nullptr;
    };
    /// Strong to weak. Valid until the next change.
    [[nodiscard]] std::vector<Site> sites(const pxr::SdfPath& prim);

private:
    stage::Composition& composition();
    void listLayers(const pxr::PcpLayerStack& stack);

    const StageHost& host_;
    std::unique_ptr<stage::Composition> own_;
    std::vector<Layer> layers_;
    std::uint64_t listed_ = 0;  // the revision that layers_ belongs to
};

}  // namespace usdlive::layers
