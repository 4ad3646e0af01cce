// Maps the values of a layer to the stage: layer offsets, asset paths and path expressions.
#include "usdlive/client/usd/stage/ValueSite.h"

#include <pxr/base/vt/array.h>
#include <pxr/base/vt/dictionary.h>
#include <pxr/usd/ar/resolver.h>
#include <pxr/usd/ar/resolverContextBinder.h>
#include <pxr/usd/pcp/expressionVariables.h>
#include <pxr/usd/pcp/layerStack.h>
#include <pxr/usd/pcp/layerStackIdentifier.h>
#include <pxr/usd/pcp/mapExpression.h>
#include <pxr/usd/pcp/primIndex.h>
#include <pxr/usd/sdf/assetPath.h>
#include <pxr/usd/sdf/pathExpression.h>
#include <pxr/usd/sdf/timeCode.h>

#include "usd/content/MappedValue.h"

namespace usdlive::stage {

using pxr::SdfAssetPath;
using pxr::SdfPathExpression;
using pxr::SdfTimeCode;
using pxr::VtArray;
using pxr::VtValue;

namespace {

// An identifier that the layer does not change is absolute, or belongs to a resolver that is not
// loaded here.
void anchor(pxr::TfSpan<SdfAssetPath> paths, const ValueSite& site,
            const pxr::VtDictionary& variables) {
    std::vector<std::string> errors;
    for (auto& path : paths) {
        SdfAssetPath anchored = path;
        pxr::SdfAnchorAssetPaths(site.layer(), variables, {&anchored, 1}, &errors);
        path = SdfAssetPath(anchored.GetAssetPath());
    }
}

void resolve(pxr::TfSpan<SdfAssetPath> paths, const ValueSite& site, AssetPaths assetPaths) {
    const auto& ofStage = site.node.GetRootNode().GetLayerStack()->GetIdentifier();
    const pxr::ArResolverContextBinder binder(ofStage.pathResolverContext);
    const auto& variables = site.node.GetLayerStack()->GetExpressionVariables().GetVariables();
    if (assetPaths == AssetPaths::Anchored) return anchor(paths, site, variables);
    std::vector<std::string> errors;
    pxr::SdfResolveAssetPaths(site.layer(), variables, paths, &errors);
}

VtValue resolved(SdfAssetPath path, const ValueSite& site, AssetPaths assetPaths) {
    resolve({&path, 1}, site, assetPaths);
    return VtValue::Take(path);
}

VtValue resolved(VtArray<SdfAssetPath> paths, const ValueSite& site, AssetPaths assetPaths) {
    resolve({paths.data(), paths.size()}, site, assetPaths);
    return VtValue::Take(paths);
}

SdfPathExpression mappedExpression(const SdfPathExpression& expression, const ValueSite& site) {
    // Paths are relative to the prim of the spec.
    const auto absolute =
        expression.MakeAbsolute(site.path.GetPrimPath().StripAllVariantSelections());
    if (site.node.IsRootNode()) return absolute;
    return site.node.GetMapToRoot().Evaluate().MapSourceToTarget(absolute);
}

VtValue mappedExpressions(VtArray<SdfPathExpression> expressions, const ValueSite& site) {
    for (auto& expression : expressions) expression = mappedExpression(expression, site);
    return VtValue::Take(expressions);
}

VtValue ofDictionary(pxr::VtDictionary dictionary, const ValueSite& site, AssetPaths assetPaths) {
    for (auto& [key, value] : dictionary) value = toStage(value, site, assetPaths);
    return VtValue::Take(dictionary);
}

}  // namespace

const pxr::SdfLayerRefPtr& ValueSite::layer() const {
    return clip ? clip : node.GetLayerStack()->GetLayers()[layerIndex];
}

pxr::SdfLayerOffset ValueSite::layerToStage() const {
    if (clip) return pxr::SdfLayerOffset();
    const auto& toRoot = node.GetMapToRoot().GetTimeOffset();
    const auto* ofLayer = node.GetLayerStack()->GetLayerOffsetForLayer(layerIndex);
    return ofLayer ? toRoot * *ofLayer : toRoot;
}

VtValue toStage(const VtValue& value, const ValueSite& site, AssetPaths assetPaths) {
    if (!value.CanTransform()) return value;
    if (value.IsHolding<SdfAssetPath>())
        return resolved(value.UncheckedGet<SdfAssetPath>(), site, assetPaths);
    if (value.IsHolding<VtArray<SdfAssetPath>>())
        return resolved(value.UncheckedGet<VtArray<SdfAssetPath>>(), site, assetPaths);
    if (value.IsHolding<SdfPathExpression>())
        return VtValue(mappedExpression(value.UncheckedGet<SdfPathExpression>(), site));
    if (value.IsHolding<VtArray<SdfPathExpression>>())
        return mappedExpressions(value.UncheckedGet<VtArray<SdfPathExpression>>(), site);
    if (value.IsHolding<pxr::VtDictionary>())
        return ofDictionary(value.UncheckedGet<pxr::VtDictionary>(), site, assetPaths);
    return content::mapped(value, site.layerToStage());
}

}  // namespace usdlive::stage
