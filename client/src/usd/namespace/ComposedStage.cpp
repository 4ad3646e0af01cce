// Composes the prims of a stage with a PcpCache that follows its layers.
#include "usd/namespace/ComposedStage.h"

#include <pxr/usd/pcp/changes.h>
#include <pxr/usd/pcp/node.h>
#include <pxr/usd/sdf/changeList.h>
#include <pxr/usd/sdf/listOp.h>
#include <pxr/usd/sdf/schema.h>

#include <algorithm>
#include <ranges>
#include <utility>

#include "usd/stage/DepthGuard.h"

namespace usdlive {

using pxr::SdfPath;

// Follows UsdStageLoadRules: the nearest rule above decides, and a prim is loaded if a prim below
// it is.
bool StageView::isLoaded(const SdfPath& prim) const {
    if (loadRules.empty()) return true;
    for (SdfPath at = prim; !at.IsEmpty(); at = at.GetParentPath()) {
        const auto rule = loadRules.find(at);
        if (rule == loadRules.end()) continue;
        if (rule->second == Load::All || (rule->second == Load::Only && at == prim)) return true;
        break;
    }
    const bool hasRuleAbove = std::ranges::any_of(
        loadRules, [&](const auto& rule) { return prim.HasPrefix(rule.first); });
    return !hasRuleAbove || std::ranges::any_of(loadRules, [&](const auto& rule) {
        return rule.second != Load::None && rule.first != prim && rule.first.HasPrefix(prim);
    });
}

bool StageView::includes(const SdfPath& prim) const {
    return mask.empty() || std::ranges::any_of(mask, [&](const SdfPath& path) {
               return path.HasPrefix(prim) || prim.HasPrefix(path);
           });
}

}  // namespace usdlive

namespace usdlive::naming {

using pxr::PcpPrimIndex;
using pxr::SdfPath;

namespace {

// Calls `visit` with the layer and path of each opinion of `prim`, strong to weak, until it returns
// true.
template <class Visit>
void visitOpinions(const PcpPrimIndex& prim, const Visit& visit) {
    for (const auto& node : prim.GetNodeRange()) {
        if (!node.CanContributeSpecs() || !node.HasSpecs()) continue;
        for (const auto& layer : node.GetLayerStack()->GetLayers())
            if (visit(layer, node.GetPath())) return;
    }
}

// Returns true if an "active" field changed. Pcp ignores this field.
bool changesActive(const pxr::SdfLayerChangeListVec& changes) {
    for (const auto& [layer, list] : changes)
        for (const auto& [path, entry] : list.GetEntryList())
            for (const auto& [field, values] : entry.infoChanged)
                if (field == pxr::SdfFieldKeys->Active) return true;
    return false;
}

bool renamesPrims(const pxr::SdfLayerChangeListVec& changes) {
    for (const auto& [layer, list] : changes)
        for (const auto& [path, entry] : list.GetEntryList())
            if (entry.flags.didRename && path.IsPrimPath()) return true;
    return false;
}

bool hasRelocates(const PcpPrimIndex& prim) {
    for (const auto& node : prim.GetNodeRange())
        if (node.GetLayerStack()->HasRelocates()) return true;
    return false;
}

// Without relocates, the children of a prim are those that its opinions have. Asking for one of
// them does not depend on how many there are.
bool hasChildSpec(const PcpPrimIndex& prim, const pxr::TfToken& name) {
    bool found = false;
    visitOpinions(prim, [&](const auto& layer, const SdfPath& path) {
        return found = layer->HasSpec(path.AppendChild(name));
    });
    return found;
}

bool canBeInstance(const PcpPrimIndex& prim) {
    bool instanceable = false;
    visitOpinions(prim, [&](const auto& layer, const SdfPath& path) {
        return layer->HasField(path, pxr::SdfFieldKeys->Instanceable, &instanceable);
    });
    return instanceable;
}

}  // namespace

ComposedStage::ComposedStage(const pxr::SdfLayerHandle& root, const pxr::SdfLayerHandle& session,
                             const StageView& view)
    : ComposedStage({root, session, stage::contextOf(root)}, view) {}

ComposedStage::ComposedStage(pxr::PcpLayerStackIdentifier layers, const StageView& view)
    : layers_(std::move(layers)),
      root_(layers_.rootLayer),
      session_(layers_.sessionLayer),
      view_(view) {
    makeComposition();
    changedKey_ = pxr::TfNotice::Register(pxr::TfCreateWeakPtr(this), &ComposedStage::onChanged);
}

ComposedStage::~ComposedStage() { pxr::TfNotice::Revoke(changedKey_); }

void ComposedStage::makeComposition() {
    uncomposed_ = {SdfPath::AbsoluteRootPath()};
    hasInstances_ = false;
    sources_.clear();
    opened_.clear();
    composition_ = std::make_unique<stage::Composition>(
        layers_, view_.muted,
        stage::Composition::Scope{
            [this](const auto& prim, auto* names) { return composesChildren(prim, names); },
            [this](const SdfPath& path) { return view_.isLoaded(path); }},
        view_.variantFallbacks);
}

void ComposedStage::onChanged(const pxr::SdfNotice::LayersDidChangeSentPerLayer& notice) {
    if (std::this_thread::get_id() != thread_) {
        stale_ = true;
        return;
    }
    if (stale_) return;
    // Pcp cannot follow a prim that it has not composed yet.
    if (!uncomposed_.empty() && renamesPrims(notice.GetChangeListVec()))
        uncomposed_ = {SdfPath::AbsoluteRootPath()};
    pxr::PcpChanges changes;
    composition_->guard(notice.GetChangeListVec(), changes);
    changes.DidChange(&composition_->cache(), notice.GetChangeListVec());
    if (changesActive(notice.GetChangeListVec())) uncomposed_ = {SdfPath::AbsoluteRootPath()};
    if (changes.IsEmpty()) return;
    noteChanges(changes);
    composition_->apply(changes);
    dropOldInstances(changes);
}

// Collects the prims that Pcp drops from its cache. If there are instances, all prims are visited
// again, because another instance may now be the source of a prototype.
void ComposedStage::noteChanges(const pxr::PcpChanges& changes) {
    for (const auto& [cache, change] : changes.GetCacheChanges()) {
        if (cache != &composition_->cache()) continue;
        for (const auto* paths :
             {&change.didChangeSignificantly, &change.didChangePrims, &change.didChangeSpecs})
            for (const SdfPath& path : *paths)
                if (path.IsAbsoluteRootOrPrimPath()) uncomposed_.insert(path);
    }
    if (hasInstances_ || !changes.GetLayerStackChanges().empty())
        uncomposed_ = {SdfPath::AbsoluteRootPath()};
}

// A spec that comes or goes can make a prim an instance, or an instance of another prototype. Pcp
// keeps the prim's index in such a case.
void ComposedStage::dropOldInstances(const pxr::PcpChanges& changes) {
    pxr::PcpChanges dropped;
    for (const auto& [cache, change] : changes.GetCacheChanges()) {
        if (cache != &composition_->cache()) continue;
        for (const SdfPath& path : change.didChangeSpecs) {
            const auto* prim =
                path.IsPrimPath() ? composition_->cache().FindPrimIndex(path) : nullptr;
            if (prim && (prim->IsInstanceable() || canBeInstance(*prim)))
                dropped.DidChangeSignificantly(&composition_->cache(), path);
        }
    }
    if (dropped.IsEmpty()) return;
    noteChanges(dropped);
    composition_->apply(dropped);
}

pxr::PcpCache& ComposedStage::composed() {
    if (stale_.exchange(false)) makeComposition();
    if (!uncomposed_.empty()) compose();
    return composition_->cache();
}

pxr::PcpLayerStackRefPtr ComposedStage::localLayers() {
    return pxr::PcpLayerStackRefPtr(composed().GetLayerStack());
}

void ComposedStage::compose() {
    pxr::SdfPathVector roots = reachable(std::exchange(uncomposed_, {}));
    while (!roots.empty()) {
        composition_->composeInParallel(roots);
        roots = hasInstances_ ? newSources() : pxr::SdfPathVector();
    }
}

// Several threads call it at once.
bool ComposedStage::composesChildren(const PcpPrimIndex& prim, pxr::TfTokenVector* names) {
    if (!isActive(prim)) return false;
    if (prim.GetPath().GetPathElementCount() >= stage::kDeepestPath) return false;
    if (prim.IsInstanceable()) hasInstances_ = true;
    if (prim.IsInstanceable() && !opened_.contains(prim.GetPath())) return false;
    if (view_.mask.empty()) return true;
    pxr::PcpTokenSet prohibited;
    prim.ComputePrimChildNames(names, &prohibited);
    std::erase_if(*names, [&](const pxr::TfToken& name) {
        return !view_.includes(prim.GetPath().AppendChild(name));
    });
    return !names->empty();
}

// Returns the paths that an active, composed parent shows, without paths below other ones.
pxr::SdfPathVector ComposedStage::reachable(const pxr::SdfPathSet& paths) const {
    std::unordered_map<SdfPath, pxr::PcpTokenSet, SdfPath::Hash> children;
    const auto isChild = [&](const SdfPath& path) {
        const SdfPath parent = path.GetParentPath();
        const auto* index = composition_->cache().FindPrimIndex(parent);
        if (index && !hasRelocates(*index))
            return isActive(*index) && hasChildSpec(*index, path.GetNameToken()) &&
                   view_.includes(path) && stage::canBePrim(path);
        const auto [known, isNew] = children.try_emplace(parent);
        if (index && isNew && isActive(*index)) {
            pxr::TfTokenVector names;
            pxr::PcpTokenSet prohibited;
            index->ComputePrimChildNames(&names, &prohibited);
            for (const auto& name : names) known->second.insert(name);
        }
        return known->second.count(path.GetNameToken()) > 0 && view_.includes(path) &&
               stage::canBePrim(path);
    };
    pxr::SdfPathVector roots(paths.begin(), paths.end());
    SdfPath::RemoveDescendentPaths(&roots);
    std::erase_if(roots, [&](const SdfPath& path) {
        return path != SdfPath::AbsoluteRootPath() && !isChild(path);
    });
    return roots;
}

// Returns the instances whose children are composed next: the first instance of each prototype that
// has no source yet.
pxr::SdfPathVector ComposedStage::newSources() {
    std::unordered_map<pxr::PcpInstanceKey, SdfPath, pxr::PcpInstanceKey::Hash> first;
    composition_->cache().ForEachPrimIndex([&](const PcpPrimIndex& prim) {
        if (!prim.IsInstanceable() || !isActive(prim)) return;
        const auto [known, isNew] = first.emplace(pxr::PcpInstanceKey(prim), prim.GetPath());
        const auto source = sources_.find(known->first);
        if (source != sources_.end() && source->second == prim.GetPath())
            known->second = prim.GetPath();
        else if (!isNew && (source == sources_.end() || known->second != source->second))
            known->second = std::min(known->second, prim.GetPath());
    });
    pxr::SdfPathVector fresh;
    opened_.clear();
    for (const auto& [key, path] : first) {
        const auto source = sources_.find(key);
        if (source == sources_.end() || source->second != path) fresh.push_back(path);
        opened_.insert(path);
    }
    sources_ = std::move(first);
    return fresh;
}

const PcpPrimIndex* ComposedStage::prim(const SdfPath& path) {
    if (!stage::canBePrim(path) || path.ContainsPrimVariantSelection()) return nullptr;
    const auto& cache = composed();
    const auto* index = cache.FindPrimIndex(SdfPath::AbsoluteRootPath());
    SdfPath at = SdfPath::AbsoluteRootPath();
    pxr::TfTokenVector names;
    for (SdfPath up = path; up != at; up = up.GetParentPath()) names.push_back(up.GetNameToken());
    for (const auto& name : std::views::reverse(names)) {
        if (!index || !isActive(*index)) return nullptr;
        if (index->IsInstanceable())
            if (const auto source = sources_.find(pxr::PcpInstanceKey(*index));
                source != sources_.end())
                at = source->second;
        at = at.AppendChild(name);
        index = cache.FindPrimIndex(at);
        if (!index || !index->IsValid() || !index->HasSpecs()) return nullptr;
    }
    return index;
}

std::string ComposedStage::whyLeftOut(const SdfPath& path) {
    (void)composed();
    if (!composition_->leavesOut(path)) return {};
    for (const auto& problem : composition_->depthProblems())
        if (path.HasPrefix(problem.prim) && problem.prim.IsPrimPath()) return problem.message;
    return {};
}

bool ComposedStage::isInstance(const SdfPath& path) {
    const auto* index = prim(path);
    return index && isActive(*index) && index->IsInstanceable();
}

bool ComposedStage::isInstanceProxy(const SdfPath& path) {
    for (SdfPath at = path.GetParentPath(); at.IsPrimPath(); at = at.GetParentPath())
        if (isInstance(at)) return true;
    return false;
}

bool ComposedStage::isActive(const PcpPrimIndex& prim) {
    bool active = true;
    visitOpinions(prim, [&](const auto& layer, const SdfPath& path) {
        return layer->HasField(path, pxr::SdfFieldKeys->Active, &active);
    });
    return active;
}

bool ComposedStage::hasAuthoredProperty(const PcpPrimIndex& prim, const pxr::TfToken& name) {
    bool found = false;
    visitOpinions(prim, [&](const auto& layer, const SdfPath& path) {
        return found = layer->HasSpec(path.AppendProperty(name));
    });
    return found;
}

pxr::TfToken ComposedStage::typeName(const PcpPrimIndex& prim) {
    pxr::TfToken type;
    visitOpinions(prim, [&](const auto& layer, const SdfPath& path) {
        return layer->HasField(path, pxr::SdfFieldKeys->TypeName, &type) && !type.IsEmpty();
    });
    return type;
}

pxr::TfTokenVector ComposedStage::apiSchemas(const PcpPrimIndex& prim) {
    static const pxr::TfToken field("apiSchemas");
    std::vector<pxr::SdfTokenListOp> opinions;
    visitOpinions(prim, [&](const auto& layer, const SdfPath& path) {
        if (pxr::SdfTokenListOp op; layer->HasField(path, field, &op)) opinions.push_back(op);
        return false;
    });
    pxr::TfTokenVector schemas;
    for (const auto& op : std::views::reverse(opinions)) op.ApplyOperations(&schemas);
    return schemas;
}

}  // namespace usdlive::naming
