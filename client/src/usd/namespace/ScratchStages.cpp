// Tries the edits of a batch on copies. A real composition validates each edit, and no layer of a
// stage changes before all edits are valid.
#include "usd/namespace/ScratchStages.h"

#include <pxr/base/tf/stringUtils.h>
#include <pxr/usd/pcp/expressionVariables.h>
#include <pxr/usd/sdf/changeBlock.h>
#include <pxr/usd/sdf/layerUtils.h>
#include <pxr/usd/sdf/listOp.h>
#include <pxr/usd/sdf/payload.h>
#include <pxr/usd/sdf/reference.h>
#include <pxr/usd/sdf/schema.h>
#include <pxr/usd/sdf/variableExpression.h>

#include <algorithm>
#include <functional>
#include <optional>
#include <set>

#include "usd/namespace/SpecMoves.h"
#include "usdlive/common/usd/LayerFill.h"

namespace usdlive::naming {

using pxr::SdfLayerHandle;
using pxr::SdfPath;
using pxr::VtValue;

namespace {

using Rename = std::function<std::string(const std::string&)>;

template <class Arc>
VtValue withAssets(const VtValue& value, const Rename& rename) {
    auto arcs = value.UncheckedGet<pxr::SdfListOp<Arc>>();
    arcs.ModifyOperations([&](const Arc& arc) -> std::optional<Arc> {
        Arc renamed = arc;
        if (!arc.GetAssetPath().empty()) renamed.SetAssetPath(rename(arc.GetAssetPath()));
        return renamed;
    });
    return VtValue::Take(arcs);
}

// Renames the assets of references and payloads. Returns other values unchanged.
VtValue withRenamedAssets(const VtValue& value, const Rename& rename) {
    if (value.IsHolding<pxr::SdfReferenceListOp>())
        return withAssets<pxr::SdfReference>(value, rename);
    if (value.IsHolding<pxr::SdfPayloadListOp>()) return withAssets<pxr::SdfPayload>(value, rename);
    return value;
}

VtValue withRenamedAssets(const VtValue& value, const std::map<std::string, std::string>& names) {
    return withRenamedAssets(value, [&](const std::string& path) {
        const auto renamed = names.find(path);
        return renamed == names.end() ? path : renamed->second;
    });
}

std::string evaluated(const std::string& path, const pxr::VtDictionary& variables) {
    if (!pxr::SdfVariableExpression::IsExpression(path)) return path;
    const auto result = pxr::SdfVariableExpression(path).EvaluateTyped<std::string>(variables);
    return result.value.GetWithDefault<std::string>();
}

pxr::VtDictionary variablesOf(const SdfLayerHandle& layer,
                              const std::vector<ComposedStage*>& stages) {
    for (auto* stage : stages)
        for (const auto& stack : stage->composed().FindAllLayerStacksUsingLayer(layer))
            return stack->GetExpressionVariables().GetVariables();
    return {};
}

}  // namespace

ScratchStages::ScratchStages(const Stages& stages) {
    std::vector<ComposedStage*> all{stages.edited};
    all.insert(all.end(), stages.dependents.begin(), stages.dependents.end());
    chooseLayers(all);
    redirect(all);
    for (auto* stage : all) composed_.push_back(compose(*stage));
    scratch_ = {.edited = composed_.front().get(),
                .dependents = {},
                .host = stages.host,
                .editTarget = copyOf(stages.editTarget),
                .targetMapsPaths = stages.targetMapsPaths};
    for (std::size_t i = 1; i < composed_.size(); ++i)
        scratch_.dependents.push_back(composed_[i].get());
}

void ScratchStages::chooseLayers(const std::vector<ComposedStage*>& stages) {
    std::map<SdfLayerHandle, std::set<SdfLayerHandle>> uses;
    const auto choose = [&](const SdfLayerHandle& layer) { copies_.try_emplace(layer); };
    for (auto* stage : stages)
        for (const auto& layer : stage->localLayers()->GetLayers()) choose(layer);
    for (auto* stage : stages)
        for (const auto& layer : stage->composed().GetUsedLayers()) {
            if (copies_.contains(layer) || uses.contains(layer)) continue;
            const auto variables = variablesOf(layer, stages);
            for (const auto& path : layer->GetCompositionAssetDependencies())
                if (const auto used = pxr::SdfLayer::Find(
                        pxr::SdfComputeAssetPathRelativeToLayer(layer, evaluated(path, variables))))
                    uses[layer].insert(used);
        }
    for (bool more = true; more;) {
        more = false;
        for (const auto& [layer, used] : uses)
            if (!copies_.contains(layer) &&
                std::ranges::any_of(used, [&](const auto& one) { return copies_.contains(one); })) {
                choose(layer);
                more = true;
            }
    }
}

void ScratchStages::redirect(const std::vector<ComposedStage*>& stages) {
    for (auto& [layer, copy] : copies_) {
        copy.layer = usd::copyOfLayer(*layer);
        originals_[copy.layer] = layer;
    }
    for (auto& [layer, copy] : copies_) {
        const pxr::SdfChangeBlock block;
        const auto variables = variablesOf(layer, stages);
        const Rename rename = [&](const std::string& path) {
            auto renamed = redirected(layer, path, variables);
            copy.toOriginal.emplace(renamed, path);
            copy.toCopy.emplace(path, renamed);
            return renamed;
        };
        std::vector<std::string> sublayers = copy.layer->GetSubLayerPaths();
        for (auto& path : sublayers) path = rename(path);
        const auto offsets = layer->GetSubLayerOffsets();
        copy.layer->SetSubLayerPaths(sublayers);
        for (std::size_t i = 0; i < offsets.size(); ++i)
            copy.layer->SetSubLayerOffset(offsets[i], int(i));
        const SdfLayerHandle scratch = copy.layer;
        scratch->Traverse(SdfPath::AbsoluteRootPath(), [&](const SdfPath& path) {
            if (!path.IsPrimOrPrimVariantSelectionPath()) return;
            for (const auto& field : {pxr::SdfFieldKeys->References, pxr::SdfFieldKeys->Payload})
                if (VtValue value; scratch->HasField(path, field, &value))
                    scratch->SetField(path, field, withRenamedAssets(value, rename));
        });
        copy.layer->SetPermissionToEdit(layer->PermissionToEdit());
    }
}

// Copies are anonymous layers, and no path is relative to an anonymous layer.
std::string ScratchStages::redirected(const SdfLayerHandle& layer, const std::string& path,
                                      const pxr::VtDictionary& variables) const {
    const auto own = evaluated(path, variables);
    if (own.empty()) return path;
    const auto absolute = pxr::SdfComputeAssetPathRelativeToLayer(layer, own);
    const auto target = copyOf(pxr::SdfLayer::Find(absolute));
    return target ? target->GetIdentifier() : absolute;
}

SdfLayerHandle ScratchStages::copyOf(const SdfLayerHandle& layer) const {
    const auto copy = copies_.find(layer);
    return layer && copy != copies_.end() ? SdfLayerHandle(copy->second.layer) : SdfLayerHandle();
}

std::unique_ptr<ComposedStage> ScratchStages::compose(ComposedStage& stage) const {
    const auto& layers = stage.layers();
    return std::make_unique<ComposedStage>(
        pxr::PcpLayerStackIdentifier{copyOf(layers.rootLayer), copyOf(layers.sessionLayer),
                                     layers.pathResolverContext},
        stage.view());
}

void ScratchStages::apply(const Plan& plan) const {
    const auto steps = inSteps({plan});
    for (std::size_t i = 0; i < steps.size(); ++i) {
        const pxr::SdfChangeBlock block;
        if (i == 0) setArcs(plan);
        for (const auto& edit : steps[i])
            for (const auto& [original, moves] : edit.moves)
                (void)moveSpecs(copies_.at(original).layer, moves);
        if (i + 1 == steps.size()) setRelocates(plan);
    }
}

void ScratchStages::setArcs(const Plan& plan) const {
    for (const auto& [original, changes] : plan.layers) {
        const auto& [layer, toOriginal, toCopy] = copies_.at(original);
        for (const auto& arc : changes.arcs)
            layer->SetField(arc.path, arc.field, withRenamedAssets(arc.value, toCopy));
    }
}

void ScratchStages::setRelocates(const Plan& plan) const {
    for (const auto& [original, changes] : plan.layers)
        if (changes.relocates) copies_.at(original).layer->SetRelocates(*changes.relocates);
}

Plan ScratchStages::toReal(Plan plan) const {
    std::map<SdfLayerHandle, LayerPlan> layers;
    for (auto& [layer, changes] : plan.layers) {
        const auto& original = originals_.at(layer);
        for (auto& arc : changes.arcs)
            arc.value = withRenamedAssets(arc.value, copies_.at(original).toOriginal);
        layers.emplace(original, std::move(changes));
    }
    plan.layers = std::move(layers);
    for (auto& stack : plan.localLayers)
        for (auto& layer : stack)
            if (const auto original = originals_.find(layer); original != originals_.end())
                layer = original->second;
    for (auto* texts : {&plan.errors, &plan.warnings})
        for (auto& text : *texts)
            for (const auto& [copy, original] : originals_)
                text = pxr::TfStringReplace(text, copy->GetIdentifier(), original->GetIdentifier());
    return plan;
}

}  // namespace usdlive::naming
