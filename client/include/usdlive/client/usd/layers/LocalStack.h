#pragma once

#include <pxr/usd/sdf/changeList.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/layerOffset.h>

#include <memory>
#include <optional>
#include <vector>

#include "usdlive/client/usd/layers/StageHost.h"
#include "usdlive/client/usd/stage/Composition.h"

namespace usdlive::layers {

/// A stage's local layer stack as Pcp computes it from root, session and muted layers, and what has
/// to be known of composition above it. Composed when it is asked for, and kept: see Composition.
class LocalStack {
public:
    struct Layer {
        pxr::SdfLayerHandle layer;
        pxr::SdfLayerOffset toStack;  ///< from the layer's time to the stage's
        bool ofSession = false;
    };

    explicit LocalStack(const StageHost& host);

    /// Muteness has changed, or sublayers within a change block that has not ended yet.
    void invalidate() { composition_.reset(); }
    /// What SdfNotice::LayersDidChange tells.
    void follow(const pxr::SdfLayerChangeListVec& changes);

    /// Strong to weak.
    [[nodiscard]] const std::vector<Layer>& layers();
    [[nodiscard]] const Layer* find(const pxr::SdfLayerHandle& layer);
    [[nodiscard]] double timeCodesPerSecond();

    /// A place where the composed prim has opinions.
    struct Site {
        pxr::SdfPath path;
        /// Null: the prim itself or one of its selected variants, in layers(). Otherwise it comes
        /// by another arc.
        const pxr::PcpLayerStack* foreign = nullptr;
    };
    /// Strong to weak, without payloads. Valid until the next change.
    [[nodiscard]] std::vector<Site> sites(const pxr::SdfPath& prim);

private:
    stage::Composition& composition();
    void listLayers();

    const StageHost& host_;
    std::unique_ptr<stage::Composition> composition_;
    std::vector<Layer> layers_;
};

}  // namespace usdlive::layers
