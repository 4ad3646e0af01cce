#pragma once

#include <memory>
#include <set>

#include "usdlive/client/usd/layers/LocalStack.h"
#include "usdlive/client/usd/layers/StageHost.h"

namespace usdlive::layers {

/// A plain layer stack as a stage: for programs without a UsdStage. It composes with Pcp, and has
/// all payloads loaded.
class LayerStackHost final : public StageHost {
public:
    explicit LayerStackHost(pxr::SdfLayerRefPtr root, pxr::SdfLayerRefPtr session = {});

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

private:
    [[nodiscard]] LocalStack composed() const { return LocalStack(*this); }

    const pxr::SdfLayerRefPtr root_, session_;
    std::set<std::string> muted_;
    pxr::SdfLayerHandle editTarget_;
};

}  // namespace usdlive::layers
