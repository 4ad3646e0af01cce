#include "usdlive/client/usd/layers/LocalStack.h"

#include <pxr/usd/ar/resolver.h>
#include <pxr/usd/pcp/layerStack.h>
#include <pxr/usd/pcp/node.h>
#include <pxr/usd/pcp/primIndex.h>

namespace usdlive::layers {

using pxr::SdfPath;

namespace {

// As UsdStage binds it.
pxr::ArResolverContext contextOf(const pxr::SdfLayerHandle& root) {
    if (root->IsAnonymous()) return pxr::ArGetResolver().CreateDefaultContext();
    return pxr::ArGetResolver().CreateDefaultContextForAsset(root->GetIdentifier());
}

// Reached from the prim's own node by variants alone?
bool isLocal(const pxr::PcpNodeRef& node) {
    for (auto at = node; at.GetArcType() != pxr::PcpArcTypeRoot; at = at.GetParentNode())
        if (at.GetArcType() != pxr::PcpArcTypeVariant) return false;
    return true;
}

}  // namespace

LocalStack::LocalStack(const StageHost& host) : host_(host) {}

pxr::PcpCache& LocalStack::cache() {
    if (cache_) return *cache_;
    const auto root = host_.rootLayer();
    cache_ = std::make_unique<pxr::PcpCache>(
        pxr::PcpLayerStackIdentifier(root, host_.sessionLayer(), contextOf(root)), "usd", true);
    cache_->RequestLayerMuting(host_.mutedLayers(), {});
    pxr::PcpErrorVector errors;
    const auto stack = cache_->ComputeLayerStack(cache_->GetLayerStackIdentifier(), &errors);
    const std::size_t ofSession = stack->GetSessionLayers().size();
    layers_.clear();
    for (const auto& layer : stack->GetLayers()) {
        const auto* offset = stack->GetLayerOffsetForLayer(layers_.size());
        layers_.push_back({layer, offset ? *offset : pxr::SdfLayerOffset(), false});
        layers_.back().ofSession = layers_.size() <= ofSession;
    }
    primsChanged_ = false;
    return *cache_;
}

const std::vector<LocalStack::Layer>& LocalStack::layers() {
    (void)cache();
    return layers_;
}

const LocalStack::Layer* LocalStack::find(const pxr::SdfLayerHandle& layer) {
    for (const auto& one : layers())
        if (one.layer == layer) return &one;
    return nullptr;
}

double LocalStack::timeCodesPerSecond() { return cache().GetLayerStack()->GetTimeCodesPerSecond(); }

void LocalStack::includePayloads(const SdfPath& prim) {
    if (!prim.IsAbsoluteRootOrPrimPath()) return;
    if (primsChanged_) invalidate();
    pxr::SdfPathSet payloads;
    for (const SdfPath& above : prim.GetPrefixes())
        if (!cache().IsPayloadIncluded(above)) payloads.insert(above);
    if (!payloads.empty()) cache().RequestPayloads(payloads, {});
}

const pxr::PcpPrimIndex* LocalStack::primIndex(const SdfPath& prim) {
    if (!prim.IsAbsoluteRootOrPrimPath()) return nullptr;
    if (primsChanged_) invalidate();
    pxr::PcpErrorVector errors;
    const auto& index = cache().ComputePrimIndex(prim, &errors);
    return index.IsValid() ? &index : nullptr;
}

// Without payloads: they are weaker than all that is looked for, and reading them is the stage's
// decision.
std::vector<LocalStack::Site> LocalStack::sites(const SdfPath& prim) {
    std::vector<Site> sites;
    const auto* index = primIndex(prim);
    if (!index) return sites;
    for (const auto& node : index->GetNodeRange()) {
        if (!node.CanContributeSpecs() || !node.HasSpecs()) continue;
        sites.push_back({node.GetPath(), isLocal(node) ? nullptr : &*node.GetLayerStack()});
    }
    return sites;
}

std::vector<pxr::TfToken> LocalStack::childNames(const SdfPath& prim) {
    pxr::TfTokenVector names;
    pxr::PcpTokenSet prohibited;
    includePayloads(prim);
    if (const auto* index = primIndex(prim)) index->ComputePrimChildNames(&names, &prohibited);
    return names;
}

std::vector<pxr::TfToken> LocalStack::propertyNames(const SdfPath& prim) {
    pxr::TfTokenVector names;
    includePayloads(prim);
    if (const auto* index = primIndex(prim)) index->ComputePrimPropertyNames(&names);
    return names;
}

pxr::SdfLayerHandleSet LocalStack::usedLayers() {
    if (primsChanged_) invalidate();
    pxr::PcpErrorVector errors;
    cache().ComputePrimIndexesInParallel(
        SdfPath::AbsoluteRootPath(), &errors,
        [](const pxr::PcpPrimIndex&, pxr::TfTokenVector*) { return true; },
        [](const SdfPath&) { return true; });
    return cache().GetUsedLayers();
}

}  // namespace usdlive::layers
