// A stage without UsdStage: a layer stack that Pcp composes.
#pragma once

#include <pxr/base/tf/notice.h>
#include <pxr/base/tf/weakBase.h>
#include <pxr/usd/sdf/notice.h>

#include <memory>
#include <set>
#include <thread>

#include "usdlive/client/usd/layers/StageHost.h"

namespace usdlive::layers {

/// A plain layer stack as a stage, for programs without a UsdStage. Composes with Pcp and loads all
/// payloads.
class LayerStackHost final : public StageHost, public pxr::TfWeakBase {
public:
    explicit LayerStackHost(pxr::SdfLayerRefPtr root, pxr::SdfLayerRefPtr session = {});
    ~LayerStackHost() override;

    [[nodiscard]] pxr::SdfLayerHandle rootLayer() const override { return root_; }
    [[nodiscard]] pxr::SdfLayerHandle sessionLayer() const override { return session_; }
    [[nodiscard]] std::vector<std::string> mutedLayers() const override;
    void muteAndUnmute(const std::vector<std::string>& mute,
                       const std::vector<std::string>& unmute) override;
    [[nodiscard]] pxr::SdfLayerHandle editTarget() const override;
    bool setEditTarget(const pxr::SdfLayerHandle& layer) override;
    [[nodiscard]] std::vector<pxr::SdfLayerHandle> usedLayers() const override;
    [[nodiscard]] std::vector<pxr::TfToken> childNames(const pxr::SdfPath& prim) const override;
    [[nodiscard]] std::vector<pxr::TfToken> propertyNames(const pxr::SdfPath& prim) const override;
    [[nodiscard]] stage::Composition* composition() const override;

private:
    void onChanged(const pxr::SdfNotice::LayersDidChange& notice);

    const pxr::SdfLayerRefPtr root_, session_;
    std::set<std::string> muted_;
    pxr::SdfLayerHandle editTarget_;
    mutable std::unique_ptr<stage::Composition> composition_;  // created when it is first needed
    const std::thread::id thread_ = std::this_thread::get_id();
    pxr::TfNotice::Key changedKey_;
};

}  // namespace usdlive::layers
