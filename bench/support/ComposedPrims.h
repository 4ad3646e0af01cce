// Composes all prims of a stage again after each change, as a UsdStage does.
#pragma once

#include <pxr/base/tf/notice.h>
#include <pxr/base/tf/weakBase.h>
#include <pxr/usd/pcp/cache.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/notice.h>

#include <cstddef>

namespace usdlive::bench {

/// All prim indexes of a stage. Like a UsdStage, it composes a prim and everything below it again,
/// within the change notice, when Pcp says that the change is significant.
class ComposedPrims : public pxr::TfWeakBase {
public:
    explicit ComposedPrims(const pxr::SdfLayerHandle& root);
    ~ComposedPrims();
    ComposedPrims(const ComposedPrims&) = delete;
    ComposedPrims& operator=(const ComposedPrims&) = delete;

    /// The number of compositions of prims since the last call.
    [[nodiscard]] std::size_t takeComposed();

private:
    void compose(const pxr::SdfPath& path);
    void onChanged(const pxr::SdfNotice::LayersDidChange& notice);

    pxr::PcpCache cache_;
    std::size_t composed_ = 0;
    pxr::TfNotice::Key key_;
};

}  // namespace usdlive::bench
