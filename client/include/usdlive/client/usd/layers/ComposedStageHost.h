// A stage::Stage whose layers are edited.
#pragma once

#include <string>
#include <vector>

#include "usdlive/client/usd/layers/StageHost.h"

namespace usdlive::stage {
class Stage;
}

namespace usdlive::layers {

/// A stage::Stage for the layers API. Both share the composition, the muted layers and the edit
/// target. A program with a pxr::UsdStage implements StageHost over that instead, as
/// client/examples/layers does.
class ComposedStageHost final : public StageHost {
public:
    /// `stage` must outlive this object.
    explicit ComposedStageHost(stage::Stage& stage) : stage_(stage) {}

    [[nodiscard]] pxr::SdfLayerHandle rootLayer() const override;
    [[nodiscard]] pxr::SdfLayerHandle sessionLayer() const override;
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
    stage::Stage& stage_;
};

}  // namespace usdlive::layers
