// Lets a NamespaceEditor edit a composed stage of this library.
#include "usdlive/client/usd/namespace/EditedStage.h"

#include "usdlive/client/usd/schema/PrimDefinition.h"
#include "usdlive/client/usd/schema/SchemaRegistry.h"
#include "usdlive/client/usd/stage/Stage.h"

namespace usdlive {

using pxr::SdfPath;

namespace {

StageView::Load viewed(stage::LoadRules::Rule rule) {
    switch (rule) {
        case stage::LoadRules::Rule::All:
            return StageView::Load::All;
        case stage::LoadRules::Rule::Only:
            return StageView::Load::Only;
        case stage::LoadRules::Rule::None:
            break;
    }
    return StageView::Load::None;
}

class ComposedEditedStage final : public EditedStage {
public:
    explicit ComposedEditedStage(stage::Stage& stage) : root_(stage.pseudoRoot()) {}

    [[nodiscard]] pxr::SdfLayerHandle rootLayer() const override {
        return root_ ? root_.stage().rootLayer() : pxr::SdfLayerHandle();
    }
    [[nodiscard]] pxr::SdfLayerHandle sessionLayer() const override {
        return root_ ? root_.stage().sessionLayer() : pxr::SdfLayerHandle();
    }
    [[nodiscard]] StageView view() const override {
        const auto& stage = root_.stage();
        StageView view{
            .muted = stage.mutedLayers(), .loadRules = {}, .mask = {}, .variantFallbacks = {}};
        for (const auto& [path, rule] : stage.loadRules().rules())
            view.loadRules.emplace(path, viewed(rule));
        if (!stage.mask().isAll()) {
            view.mask = stage.mask().paths();
            if (view.mask.empty()) view.mask.emplace_back();  // an empty path includes no prim
        }
        return view;
    }
    [[nodiscard]] EditTarget editTarget() const override {
        const auto& target = root_.stage().editTarget();
        return {target.layer(), !target.mapping().IsIdentityPathMapping()};
    }
    [[nodiscard]] bool isBuiltIn(const pxr::TfToken& typeName, const pxr::TfTokenVector& apiSchemas,
                                 const pxr::TfToken& property) const override {
        const auto& schemas = root_.stage().schemas();
        const auto fallbacks = root_.stage().metadata(pxr::TfToken("fallbackPrimTypes"));
        const auto type = schemas.effectiveType(
            typeName, fallbacks.GetWithDefault<pxr::VtDictionary>(pxr::VtDictionary()));
        return schemas.isBuiltIn(type, apiSchemas, property);
    }
    [[nodiscard]] bool isInPrototype(const SdfPath& path) const override {
        const auto prim = root_.stage().prim(path);
        return prim && prim.has(stage::PrimFlag::InPrototype) && !prim.isInstanceProxy();
    }

private:
    const stage::Prim root_;  // becomes invalid when the stage is destroyed
};

}  // namespace

std::unique_ptr<EditedStage> editedStage(stage::Stage& stage) {
    return std::make_unique<ComposedEditedStage>(stage);
}

}  // namespace usdlive
