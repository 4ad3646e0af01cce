#pragma once

#include <pxr/usd/pcp/cache.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/layerOffset.h>

#include <memory>
#include <optional>
#include <vector>

#include "usdlive/client/usd/layers/StageHost.h"

namespace usdlive::layers {

/// A stage's local layer stack as Pcp computes it from root, session and muted layers, and what has
/// to be known of composition above it. Computed when asked for and kept until invalidate().
class LocalStack {
public:
    struct Layer {
        pxr::SdfLayerHandle layer;
        pxr::SdfLayerOffset toStack;  ///< from the layer's time to the stage's
        bool ofSession = false;
    };

    explicit LocalStack(const StageHost& host);

    /// Sublayers, offsets or muteness have changed.
    void invalidate() { cache_.reset(); }
    /// Something was authored: prim indexes are computed anew.
    void primsChanged() { primsChanged_ = true; }

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

    [[nodiscard]] std::vector<pxr::TfToken> childNames(const pxr::SdfPath& prim);
    [[nodiscard]] std::vector<pxr::TfToken> propertyNames(const pxr::SdfPath& prim);
    [[nodiscard]] pxr::SdfLayerHandleSet usedLayers();

private:
    pxr::PcpCache& cache();
    void includePayloads(const pxr::SdfPath& prim);
    [[nodiscard]] const pxr::PcpPrimIndex* primIndex(const pxr::SdfPath& prim);

    const StageHost& host_;
    std::unique_ptr<pxr::PcpCache> cache_;
    std::vector<Layer> layers_;
    bool primsChanged_ = false;
};

}  // namespace usdlive::layers
