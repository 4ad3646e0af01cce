// A pxr::UsdStage whose layers are edited, for programs whose OpenUSD has that class.
#pragma once

#include <pxr/usd/usd/editTarget.h>
#include <pxr/usd/usd/prim.h>
#include <pxr/usd/usd/stage.h>
#include <usdlive/client/usd/layers/StageHost.h>

#include <string>
#include <utility>
#include <vector>

class UsdStageHost final : public usdlive::layers::StageHost {
public:
    explicit UsdStageHost(pxr::UsdStageRefPtr stage) : stage_(std::move(stage)) {}

    pxr::SdfLayerHandle rootLayer() const override { return stage_->GetRootLayer(); }
    pxr::SdfLayerHandle sessionLayer() const override { return stage_->GetSessionLayer(); }
    std::vector<std::string> mutedLayers() const override { return stage_->GetMutedLayers(); }
    void muteAndUnmute(const std::vector<std::string>& mute,
                       const std::vector<std::string>& unmute) override {
        auto allowed = mute;
        std::erase(allowed, rootLayer()->GetIdentifier());
        stage_->MuteAndUnmuteLayers(allowed, unmute);
    }
    pxr::SdfLayerHandle editTarget() const override { return stage_->GetEditTarget().GetLayer(); }
    bool setEditTarget(const pxr::SdfLayerHandle& layer) override {
        if (!layer || !stage_->HasLocalLayer(layer)) return false;
        stage_->SetEditTarget(stage_->GetEditTargetForLocalLayer(layer));
        return true;
    }
    std::vector<pxr::SdfLayerHandle> usedLayers() const override { return stage_->GetUsedLayers(); }
    std::vector<pxr::TfToken> childNames(const pxr::SdfPath& path) const override {
        const auto prim = stage_->GetPrimAtPath(path);
        return prim ? prim.GetAllChildrenNames() : std::vector<pxr::TfToken>();
    }
    std::vector<pxr::TfToken> propertyNames(const pxr::SdfPath& path) const override {
        const auto prim = stage_->GetPrimAtPath(path);
        return prim ? prim.GetPropertyNames() : std::vector<pxr::TfToken>();
    }

private:
    const pxr::UsdStageRefPtr stage_;
};
