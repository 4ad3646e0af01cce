// A PcpCache that follows the changes of its layers, as the one of a UsdStage does.
#include "usdlive/client/usd/stage/Composition.h"

#include <pxr/usd/ar/resolver.h>
#include <pxr/usd/pcp/changes.h>
#include <pxr/usd/pcp/layerStack.h>
#include <pxr/usd/pcp/primIndex.h>

namespace usdlive::stage {

using pxr::SdfPath;

namespace {

// As UsdStage binds it.
pxr::ArResolverContext contextOf(const pxr::SdfLayerHandle& root) {
    if (root->IsAnonymous()) return pxr::ArGetResolver().CreateDefaultContext();
    return pxr::ArGetResolver().CreateDefaultContextForAsset(root->GetIdentifier());
}

}  // namespace

Composition::Composition(const pxr::SdfLayerHandle& root, const pxr::SdfLayerHandle& session,
                         const std::vector<std::string>& muted)
    : cache_(std::make_unique<pxr::PcpCache>(
          pxr::PcpLayerStackIdentifier(root, session, contextOf(root)), "usd", true)) {
    cache_->RequestLayerMuting(muted, {});
    pxr::PcpErrorVector errors;
    (void)cache_->ComputeLayerStack(cache_->GetLayerStackIdentifier(), &errors);
}

bool Composition::follow(const pxr::SdfLayerChangeListVec& changes) {
    pxr::PcpChanges follow;
    follow.DidChange(cache_.get(), changes);
    if (follow.IsEmpty()) return false;
    const auto& stacks = follow.GetLayerStackChanges();
    const bool local = stacks.contains(pxr::PcpLayerStackPtr(cache_->GetLayerStack()));
    follow.Apply();
    return local;
}

const pxr::PcpPrimIndex* Composition::primIndex(const SdfPath& prim) {
    if (!prim.IsAbsoluteRootOrPrimPath()) return nullptr;
    const auto* index = cache_->FindPrimIndex(prim);
    if (!index) {
        pxr::PcpErrorVector errors;
        index = &cache_->ComputePrimIndex(prim, &errors);
        ++primsComposed_;
    }
    return index->IsValid() ? index : nullptr;
}

void Composition::includePayloads(const SdfPath& prim) {
    if (!prim.IsAbsoluteRootOrPrimPath()) return;
    pxr::SdfPathSet payloads;
    for (const SdfPath& above : prim.GetPrefixes())
        if (!cache_->IsPayloadIncluded(above)) payloads.insert(above);
    if (payloads.empty()) return;
    pxr::PcpChanges changes;
    cache_->RequestPayloads(payloads, {}, &changes);
    changes.Apply();
}

pxr::TfTokenVector Composition::childNames(const SdfPath& prim) {
    pxr::TfTokenVector names;
    pxr::PcpTokenSet prohibited;
    if (const auto* index = primIndex(prim)) index->ComputePrimChildNames(&names, &prohibited);
    return names;
}

pxr::TfTokenVector Composition::propertyNames(const SdfPath& prim) {
    pxr::TfTokenVector names;
    if (const auto* index = primIndex(prim)) index->ComputePrimPropertyNames(&names);
    return names;
}

pxr::SdfLayerHandleSet Composition::usedLayers() {
    pxr::PcpErrorVector errors;
    cache_->ComputePrimIndexesInParallel(
        SdfPath::AbsoluteRootPath(), &errors,
        [](const pxr::PcpPrimIndex&, pxr::TfTokenVector*) { return true; },
        [](const SdfPath&) { return true; });
    return cache_->GetUsedLayers();
}

}  // namespace usdlive::stage
