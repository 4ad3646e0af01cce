// Keeps a PcpCache up to date with its layers, like the PcpCache of a UsdStage.
#include "usd/stage/Composition.h"

#include <pxr/usd/ar/resolver.h>
#include <pxr/usd/pcp/layerStack.h>
#include <pxr/usd/pcp/primIndex.h>

#include <algorithm>
#include <atomic>
#include <utility>

namespace usdlive::stage {

using pxr::SdfPath;

namespace {

// Returns the same resolver context that UsdStage binds.
pxr::ArResolverContext contextOf(const pxr::SdfLayerHandle& root) {
    if (root->IsAnonymous()) return pxr::ArGetResolver().CreateDefaultContext();
    return pxr::ArGetResolver().CreateDefaultContextForAsset(root->GetIdentifier());
}

Composition::Scope everything(Composition::Payloads payloads) {
    return {[](const pxr::PcpPrimIndex&, pxr::TfTokenVector*) { return true; },
            [payloads](const SdfPath&) { return payloads == Composition::Payloads::All; }};
}

}  // namespace

Composition::Composition(const pxr::SdfLayerHandle& root, const pxr::SdfLayerHandle& session,
                         const std::vector<std::string>& muted, Payloads payloads)
    : Composition(root, session, muted, everything(payloads)) {}

Composition::Composition(const pxr::SdfLayerHandle& root, const pxr::SdfLayerHandle& session,
                         const std::vector<std::string>& muted, Scope scope)
    : cache_(std::make_unique<pxr::PcpCache>(
          pxr::PcpLayerStackIdentifier(root, session, contextOf(root)), "usd", true)),
      muted_(muted),
      scope_(std::move(scope)) {
    cache_->RequestLayerMuting(muted, {});
    pxr::PcpErrorVector errors;
    (void)cache_->ComputeLayerStack(cache_->GetLayerStackIdentifier(), &errors);
}

void Composition::follow(const pxr::SdfLayerChangeListVec& changes) {
    pxr::PcpChanges follow;
    follow.DidChange(cache_.get(), changes);
    apply(follow);
}

void Composition::setMuted(const std::vector<std::string>& muted) {
    pxr::PcpChanges changes;
    setMuted(muted, changes);
    apply(changes);
}

void Composition::setMuted(const std::vector<std::string>& muted, pxr::PcpChanges& changes) {
    const auto without = [](const auto& all, const auto& others) {
        std::vector<std::string> left;
        for (const auto& one : all)
            if (std::ranges::find(others, one) == others.end()) left.push_back(one);
        return left;
    };
    cache_->RequestLayerMuting(without(muted, muted_), without(muted_, muted), &changes);
    muted_ = muted;
}

void Composition::apply(const pxr::PcpChanges& changes) {
    if (changes.IsEmpty()) return;
    complete_ = false;
    if (changes.GetLayerStackChanges().contains(pxr::PcpLayerStackPtr(cache_->GetLayerStack())))
        ++localRevision_;
    changes.Apply();
}

const pxr::PcpLayerStack& Composition::localLayers() const { return *cache_->GetLayerStack(); }

const pxr::PcpPrimIndex* Composition::primIndex(const SdfPath& prim) {
    if (!prim.IsAbsoluteRootOrPrimPath()) return nullptr;
    const auto* index = cache_->FindPrimIndex(prim);
    if (!index) index = compose(prim);
    return index->IsValid() ? index : nullptr;
}

// Composes parents first. Pcp would compose them too, but without counting them and without their
// payloads.
const pxr::PcpPrimIndex* Composition::compose(const SdfPath& prim) {
    if (prim != SdfPath::AbsoluteRootPath()) (void)primIndex(prim.GetParentPath());
    pxr::PcpErrorVector errors;
    const auto* index = &cache_->ComputePrimIndex(prim, &errors);
    ++primsComposed_;
    if (!index->HasAnyPayloads() || cache_->IsPayloadIncluded(prim) || !scope_.payloads(prim))
        return index;
    cache_->RequestPayloads({prim}, {});
    ++primsComposed_;
    return &cache_->ComputePrimIndex(prim, &errors);
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

void Composition::composeInParallel(const pxr::SdfPathVector& roots) {
    std::atomic<std::size_t> visited = 0;
    pxr::PcpErrorVector errors;
    cache_->ComputePrimIndexesInParallel(
        roots, &errors,
        [&](const pxr::PcpPrimIndex& index, pxr::TfTokenVector* names) {
            ++visited;
            return scope_.children(index, names);
        },
        scope_.payloads);
    primsComposed_ += visited;
}

void Composition::composeAll() {
    const auto count = [&] {
        std::size_t prims = 0;
        cache_->ForEachPrimIndex([&](const pxr::PcpPrimIndex&) { ++prims; });
        return prims;
    };
    const std::size_t before = count(), composed = primsComposed_;
    composeInParallel({SdfPath::AbsoluteRootPath()});
    primsComposed_ = composed + count() - before;
    complete_ = true;
}

pxr::SdfLayerHandleSet Composition::usedLayers() {
    if (!complete_) composeAll();
    return cache_->GetUsedLayers();
}

}  // namespace usdlive::stage
