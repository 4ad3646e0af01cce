// Maps paths and times of a stage to the layer that is edited, with the map functions of Pcp.
#include "usdlive/client/usd/stage/EditTarget.h"

#include <pxr/usd/pcp/layerStack.h>
#include <pxr/usd/pcp/mapExpression.h>
#include <pxr/usd/sdf/primSpec.h>

namespace usdlive::stage {

using pxr::PcpMapFunction;
using pxr::SdfPath;

EditTarget::EditTarget(const pxr::SdfLayerHandle& layer, PcpMapFunction mapping)
    : layer_(layer), mapping_(std::move(mapping)) {}

EditTarget::EditTarget(const pxr::SdfLayerHandle& layer, const pxr::SdfLayerOffset& offset)
    : EditTarget(layer, PcpMapFunction::Create(PcpMapFunction::IdentityPathMap(), offset)) {}

EditTarget::EditTarget(const pxr::SdfLayerHandle& layer, const pxr::PcpNodeRef& node)
    : layer_(layer) {
    // Pcp's map functions contain no variant selections. The path of the node contains them.
    const SdfPath site = node.GetPath(), plain = site.StripAllVariantSelections();
    mapping_ = node.GetMapToRoot().Evaluate();
    const auto& stack = node.GetLayerStack();
    if (const auto* offset = stack->GetLayerOffsetForLayer(layer))
        mapping_ = mapping_.ComposeOffset(*offset);
    if (site == plain) return;
    const auto root = mapping_.MapSourceToTarget(plain);
    mapping_ = PcpMapFunction::Create({{site, root}}, mapping_.GetTimeOffset());
}

EditTarget EditTarget::inVariant(const pxr::SdfLayerHandle& layer, const SdfPath& variant) {
    return {layer, PcpMapFunction::Create({{variant, variant.StripAllVariantSelections()}},
                                          pxr::SdfLayerOffset())};
}

SdfPath EditTarget::specPath(const SdfPath& stagePath) const {
    if (!layer_ || mapping_.IsNull()) return {};
    const SdfPath path = mapping_.MapTargetToSource(stagePath);
    if (!path.ContainsTargetPath()) return path;
    // Target paths are paths of composed prims and contain no variant selections.
    const SdfPath target = path.GetTargetPath();
    return path.ReplaceTargetPath(target.StripAllVariantSelections());
}

pxr::SdfPrimSpecHandle EditTarget::primSpec(const SdfPath& stagePath) const {
    const SdfPath path = specPath(stagePath);
    if (path.IsEmpty() || path == SdfPath::AbsoluteRootPath() || !layer_->PermissionToEdit())
        return {};
    if (auto spec = layer_->GetPrimAtPath(path)) return spec;
    return pxr::SdfCreatePrimInLayer(layer_, path);
}

double EditTarget::layerTime(double stageTime) const {
    return mapping_.GetTimeOffset().GetInverse() * stageTime;
}

}  // namespace usdlive::stage
