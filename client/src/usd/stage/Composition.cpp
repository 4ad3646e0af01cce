// Keeps a PcpCache up to date with its layers, like the PcpCache of a UsdStage.
#include "usd/stage/Composition.h"

#include <pxr/usd/ar/resolver.h>
#include <pxr/usd/ar/resolverContextBinder.h>
#include <pxr/usd/pcp/expressionVariables.h>
#include <pxr/usd/pcp/layerStack.h>
#include <pxr/usd/pcp/primIndex.h>

#include <algorithm>
#include <atomic>
#include <utility>

namespace usdlive::stage {

using pxr::SdfPath;

namespace {

Composition::Scope everything(Composition::Payloads payloads) {
    return {[](const pxr::PcpPrimIndex&, pxr::TfTokenVector*) { return true; },
            [payloads](const SdfPath&) { return payloads == Composition::Payloads::All; }};
}

// PcpLayerStack::Apply() of OpenUSD 26.8 reads freed memory if a layer stack has the same
// expression variables from another source, for example because its root layer no longer sets those
// that the stage also sets. A copy of the variables avoids this: they are then replaced.
void keepVariables(pxr::PcpChanges& changes, const pxr::PcpLayerStackIdentifier& root) {
    for (const auto& [stack, listed] : changes.GetLayerStackChanges()) {
        if (!stack || listed.didChangeSignificantly || listed.didChangeExpressionVariables)
            continue;
        auto now = pxr::PcpExpressionVariables::Compute(stack->GetIdentifier(), root);
        if (now.GetSource() == stack->GetExpressionVariables().GetSource()) continue;
        auto& change = const_cast<pxr::PcpLayerStackChanges&>(listed);
        change.didChangeExpressionVariables = true;
        change.newExpressionVariables = now.GetVariables();
    }
}

}  // namespace

// UsdStage binds the same context.
pxr::ArResolverContext contextOf(const pxr::SdfLayerHandle& root) {
    if (root->IsAnonymous()) return pxr::ArGetResolver().CreateDefaultContext();
    return pxr::ArGetResolver().CreateDefaultContextForAsset(root->GetIdentifier());
}

// This composes single prims when they are needed, so no layer is opened in advance.
Composition::Composition(const pxr::SdfLayerHandle& root, const pxr::SdfLayerHandle& session,
                         const std::vector<std::string>& muted, Payloads payloads)
    : Composition({root, session, contextOf(root)}, muted, everything(payloads), {},
                  DepthGuard::Layers::FindOnly) {}

Composition::Composition(const pxr::SdfLayerHandle& root, const pxr::SdfLayerHandle& session,
                         const std::vector<std::string>& muted, Scope scope)
    : Composition({root, session, contextOf(root)}, muted, std::move(scope), {},
                  DepthGuard::Layers::Open) {}

Composition::Composition(const pxr::PcpLayerStackIdentifier& stack,
                         const std::vector<std::string>& muted, Scope scope,
                         const pxr::PcpVariantFallbackMap& fallbacks)
    : Composition(stack, muted, std::move(scope), fallbacks, DepthGuard::Layers::Open) {}

Composition::Composition(const pxr::PcpLayerStackIdentifier& stack,
                         const std::vector<std::string>& muted, Scope scope,
                         const pxr::PcpVariantFallbackMap& fallbacks, DepthGuard::Layers layers)
    : cache_(std::make_unique<pxr::PcpCache>(stack, "usd", true)),
      muted_(muted),
      scope_(std::move(scope)),
      guard_(stack.rootLayer, stack.sessionLayer, layers) {
    cache_->SetVariantFallbacks(fallbacks);
    checkAll();
    mute(nullptr);
    pxr::PcpErrorVector errors;
    (void)cache_->ComputeLayerStack(cache_->GetLayerStackIdentifier(), &errors);
}

void Composition::follow(const pxr::SdfLayerChangeListVec& changes) {
    pxr::PcpChanges follow;
    guard(changes, follow);
    follow.DidChange(cache_.get(), changes);
    apply(follow);
}

void Composition::setMuted(const std::vector<std::string>& muted) {
    pxr::PcpChanges changes;
    setMuted(muted, changes);
    apply(changes);
}

void Composition::setMuted(const std::vector<std::string>& muted, pxr::PcpChanges& changes) {
    muted_ = muted;
    if (checkAll())
        leaveOut(changes);
    else
        mute(&changes);
}

bool Composition::checkAll() {
    const pxr::ArResolverContextBinder binder(
        cache_->GetLayerStackIdentifier().pathResolverContext);
    opened_.clear();
    return guard_.checkAll({muted_.begin(), muted_.end()},
                           scope_.payloads(SdfPath::AbsoluteRootPath()), opened_);
}

bool Composition::guard(const pxr::SdfLayerChangeListVec& layers, pxr::PcpChanges& changes) {
    const pxr::ArResolverContextBinder binder(
        cache_->GetLayerStackIdentifier().pathResolverContext);
    opened_.clear();
    const bool differs = guard_.check(
        layers,
        [this](const auto& one) { return !cache_->FindAllLayerStacksUsingLayer(one).empty(); },
        opened_);
    if (differs) leaveOut(changes);
    return differs;
}

void Composition::guardPayloads(const pxr::SdfPathSet& prims, pxr::PcpChanges& changes) {
    const pxr::ArResolverContextBinder binder(
        cache_->GetLayerStackIdentifier().pathResolverContext);
    std::vector<std::pair<pxr::SdfLayerHandle, SdfPath>> specs;
    for (const SdfPath& prim : prims)
        if (const auto* index = cache_->FindPrimIndex(prim))
            for (const auto& node : index->GetNodeRange())
                for (const auto& layer : node.GetLayerStack()->GetLayers())
                    specs.emplace_back(layer, node.GetPath());
    opened_.clear();
    if (guard_.checkPayloads(specs, opened_)) leaveOut(changes);
}

void Composition::dropLeftOut(const SdfPath& prim, pxr::TfTokenVector& names) const {
    const auto& leftOut = guard_.primsLeftOut();
    if (leftOut.empty() || prim != SdfPath::AbsoluteRootPath()) return;
    std::erase_if(names, [&](const auto& name) { return leftOut.contains(name); });
}

void Composition::leaveOut(pxr::PcpChanges& changes) {
    mute(&changes);
    changes.DidChangeSignificantly(cache_.get(), SdfPath::AbsoluteRootPath());
}

void Composition::mute(pxr::PcpChanges* changes) {
    const auto without = [](const auto& all, const auto& others) {
        std::vector<std::string> left;
        for (const auto& one : all)
            if (std::ranges::find(others, one) == others.end()) left.push_back(one);
        return left;
    };
    auto all = muted_;
    for (const auto& one : guard_.layersLeftOut())
        if (std::ranges::find(all, one) == all.end()) all.push_back(one);
    cache_->RequestLayerMuting(without(all, allMuted_), without(allMuted_, all), changes);
    allMuted_ = std::move(all);
}

void Composition::apply(pxr::PcpChanges& changes) {
    if (changes.IsEmpty()) return;
    keepVariables(changes, cache_->GetLayerStackIdentifier());
    complete_ = false;
    if (changes.GetLayerStackChanges().contains(pxr::PcpLayerStackPtr(cache_->GetLayerStack())))
        ++localRevision_;
    changes.Apply();
}

const pxr::PcpLayerStack& Composition::localLayers() const { return *cache_->GetLayerStack(); }

const pxr::PcpPrimIndex* Composition::primIndex(const SdfPath& prim) {
    if (!canBePrim(prim) || guard_.leavesOut(prim)) return nullptr;
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
    dropLeftOut(prim, names);
    return names;
}

pxr::TfTokenVector Composition::propertyNames(const SdfPath& prim) {
    pxr::TfTokenVector names;
    if (const auto* index = primIndex(prim)) index->ComputePrimPropertyNames(&names);
    return names;
}

bool Composition::composesChildren(const pxr::PcpPrimIndex& index,
                                   pxr::TfTokenVector* names) const {
    if (!scope_.children(index, names)) return false;
    if (guard_.primsLeftOut().empty() || index.GetPath() != SdfPath::AbsoluteRootPath())
        return true;
    if (names->empty()) {
        pxr::PcpTokenSet prohibited;
        index.ComputePrimChildNames(names, &prohibited);
    }
    dropLeftOut(index.GetPath(), *names);
    return !names->empty();
}

void Composition::composeInParallel(const pxr::SdfPathVector& all) {
    pxr::SdfPathVector roots;
    for (const auto& root : all)
        if (!guard_.leavesOut(root)) roots.push_back(root);
    std::atomic<std::size_t> visited = 0;
    pxr::PcpErrorVector errors;
    cache_->ComputePrimIndexesInParallel(
        roots, &errors,
        [&](const pxr::PcpPrimIndex& index, pxr::TfTokenVector* names) {
            ++visited;
            return composesChildren(index, names);
        },
        scope_.payloads);
    opened_.clear();
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
