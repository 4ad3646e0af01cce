// Composes the tree of a stage's prims.
#include "usd/stage/StageState.h"

#include <pxr/base/work/loops.h>
#include <pxr/usd/ar/resolverContextBinder.h>
#include <pxr/usd/ar/resolverScopedCache.h>
#include <pxr/usd/pcp/layerStack.h>
#include <pxr/usd/pcp/pathTranslation.h>
#include <pxr/usd/sdf/schema.h>

#include <algorithm>
#include <utility>

#include "usd/stage/Opinions.h"
#include "usd/stage/PythonLock.h"
#include "usdlive/client/usd/schema/PrimDefinition.h"
#include "usdlive/client/usd/schema/SchemaRegistry.h"

namespace usdlive::stage {

using pxr::PcpPrimIndex;
using pxr::SdfFieldKeys;
using pxr::SdfPath;
using pxr::TfToken;

namespace {

// A prim with at least so many children composes them on several threads.
constexpr std::size_t kParallelChildren = 8;

bool isActive(const PcpPrimIndex& index) {
    bool active = true;
    forEachSite(index, TfToken(), [&](const Site& site) {
        return !site.layer->HasField(site.path, SdfFieldKeys->Active, &active);
    });
    return active;
}

}  // namespace

void TfDelegatedCountIncrement(PrimNode* node) noexcept {
    node->count_.fetch_add(1, std::memory_order_relaxed);
}

void TfDelegatedCountDecrement(PrimNode* node) noexcept {
    if (node->count_.fetch_sub(1, std::memory_order_acq_rel) == 1) delete node;
}

StageState::StageState(Stage& owner, pxr::SdfLayerRefPtr rootOfStage,
                       pxr::SdfLayerRefPtr sessionOfStage, StageOptions options)
    : stage(owner),
      rootLayer(std::move(rootOfStage)),
      sessionLayer(std::move(sessionOfStage)),
      schemas(std::move(options.schemas)),
      load(std::move(options.load)),
      mask(std::move(options.mask)),
      muted(std::move(options.muted)),
      target(rootLayer),
      composition(rootLayer, sessionLayer, muted,
                  {[this](const PcpPrimIndex& index, pxr::TfTokenVector* names) {
                       return composesChildren(index, names);
                   },
                   [this](const SdfPath& path) { return load.isLoaded(path); }}) {
    std::set<Prototype*> changed;
    composeIndexes({SdfPath::AbsoluteRootPath()}, changed);
    root = PrimNodePtr(pxr::TfDelegatedCountIncrementTag,
                       new PrimNode(this, SdfPath::AbsoluteRootPath(), nullptr));
    compose(*root);
    for (auto* prototype : changed) composePrototype(*prototype);
    nodes_.reserve(composition.primsComposed());
    enter(*root);
    for (const auto& prototype : prototypes.all()) enter(*prototype->root);
    changedKey_ = pxr::TfNotice::Register(pxr::TfCreateWeakPtr(this), &StageState::onLayersChanged);
}

StageState::~StageState() {
    pxr::TfNotice::Revoke(changedKey_);
    nodes_.clear();
    detach(*root);
    for (const auto& prototype : prototypes.all()) detach(*prototype->root);
}

PrimNode* StageState::find(const SdfPath& path) const {
    const auto found = nodes_.find(path);
    return found == nodes_.end() ? nullptr : found->second;
}

Prim StageState::prim(const SdfPath& path) const {
    if (!path.IsAbsolutePath() || !path.IsAbsoluteRootOrPrimPath()) return {};
    if (auto* node = find(path)) return {node, SdfPath()};
    // The path is inside an instance, perhaps inside several. Start at the nearest prim of the
    // tree.
    pxr::SdfPathVector names;
    SdfPath above = path;
    PrimNode* node = nullptr;
    while (!node) {
        names.push_back(above);
        above = above.GetParentPath();
        if (above.IsEmpty()) return {};
        node = find(above);
    }
    for (auto at = names.rbegin(); at != names.rend(); ++at) {
        if (node->has(PrimFlag::Instance)) {
            if (!node->prototype) return {};
            node = node->prototype->root.get();
        }
        node = node->child(at->GetNameToken());
        if (!node) return {};
    }
    return {node, path};
}

pxr::SdfLayerHandle StageState::unmutedSession() const {
    const auto& layers = composition.localLayers().GetLayers();
    if (!sessionLayer || layers.empty() || layers.front() != sessionLayer) return {};
    return sessionLayer;
}

bool StageState::composesChildren(const PcpPrimIndex& index, pxr::TfTokenVector* names) {
    if (!isActive(index)) return false;
    const SdfPath& path = index.GetPath();
    if (path.GetPathElementCount() >= kDeepest) return false;
    if (index.IsInstanceable())
        return prototypes.found(path, {pxr::PcpInstanceKey(index), load.below(path),
                                       mask.below(path), composeClips(index)});
    return mask.isAll() || mask.includedChildren(path, names);
}

// Repeats the composition for instances that replace a lost source.
void StageState::composeIndexes(pxr::SdfPathVector roots, std::set<Prototype*>& changed) {
    const pxr::ArResolverScopedCache resolved;
    const pxr::ArResolverContextBinder binder(
        composition.cache().GetLayerStackIdentifier().pathResolverContext);
    do {
        composition.composeInParallel(roots);
        roots = prototypes.assignSources(changed);
    } while (!roots.empty());
}

void StageState::readFallbackTypes() {
    pxr::VtValue value;
    if (const auto session = unmutedSession())
        value = session->GetField(SdfPath::AbsoluteRootPath(), TfToken("fallbackPrimTypes"));
    const auto weaker =
        rootLayer->GetField(SdfPath::AbsoluteRootPath(), TfToken("fallbackPrimTypes"));
    fallbackTypes_ =
        value.IsHolding<pxr::VtDictionary>() ? value.Get<pxr::VtDictionary>() : pxr::VtDictionary();
    if (weaker.IsHolding<pxr::VtDictionary>())
        pxr::VtDictionaryOverRecursive(&fallbackTypes_, weaker.UncheckedGet<pxr::VtDictionary>());
}

void StageState::noteUnmoved(const PcpPrimIndex& index) {
    bool unmoved = false;
    for (const pxr::PcpNodeRef& node : index.GetNodeRange())
        unmoved = unmoved ||
                  (node.CanContributeSpecs() && node.GetLayerStack()->HasRelocates() &&
                   node.GetArcType() != pxr::PcpArcTypeRelocate &&
                   pxr::PcpTranslatePathFromNodeToRoot(node, node.GetPath()) != index.GetPath());
    if (!unmoved) return;
    const std::scoped_lock lock(removedMutex_);
    unmoved_.insert(index.GetPath());
}

void StageState::composeType(PrimNode& node) {
    node.typeName = composeTypeName(*node.index);
    node.apiSchemas = composeApiSchemas(*node.index);
    node.definition =
        &schemas->definition(fallbackTypes_.empty() && node.typeName.IsEmpty()
                                 ? node.typeName
                                 : schemas->effectiveType(node.typeName, fallbackTypes_),
                             node.apiSchemas);
}

void StageState::composeFlags(PrimNode& node) {
    const auto& index = *node.index;
    const auto& above = *node.parent;
    std::uint16_t flags = 0;
    const auto set = [&](PrimFlag flag, bool value) {
        if (value) flags = flags | flag;
    };
    const bool active = isActive(index);
    set(PrimFlag::Active, active);
    set(PrimFlag::HasPayload, index.HasAnyPayloads());
    set(PrimFlag::Loaded,
        active && (index.HasAnyPayloads() ? composition.cache().IsPayloadIncluded(index.GetPath())
                                          : above.has(PrimFlag::Loaded)));
    if (above.has(PrimFlag::Group)) {
        TfToken kind;
        forEachSite(index, TfToken(), [&](const Site& site) {
            return !site.layer->HasField(site.path, SdfFieldKeys->Kind, &kind);
        });
        if (!kind.IsEmpty()) {
            set(PrimFlag::Group, kinds.isGroup(kind));
            set(PrimFlag::Component, kinds.isComponent(kind));
            set(PrimFlag::Model, kinds.isModel(kind));
        }
    }
    const auto specifier = composeSpecifier(index);
    const bool defines = specifier != pxr::SdfSpecifierOver;
    set(PrimFlag::Abstract, above.has(PrimFlag::Abstract) || specifier == pxr::SdfSpecifierClass);
    set(PrimFlag::HasDefiningSpecifier, defines);
    set(PrimFlag::Defined, defines && above.has(PrimFlag::Defined));
    const bool instance = active && index.IsInstanceable();
    set(PrimFlag::Instance, instance);
    set(PrimFlag::InPrototype, above.has(PrimFlag::InPrototype));
    node.flags = flags;
    node.prototype = instance ? prototypes.of(index.GetPath()) : nullptr;
}

void StageState::compose(PrimNode& node) {
    if (!node.parent) {
        const auto always = PrimFlag::Active | PrimFlag::Loaded | PrimFlag::Model |
                            PrimFlag::Group | PrimFlag::Defined | PrimFlag::HasDefiningSpecifier;
        const bool isRoot = node.path == SdfPath::AbsoluteRootPath();
        node.flags = isRoot ? always | PrimFlag::PseudoRoot
                            : always | PrimFlag::PrototypeRoot | PrimFlag::InPrototype;
        node.definition = &schemas->definition(TfToken(), {});
        if (isRoot) {
            node.index = composition.cache().FindPrimIndex(node.path);
            readFallbackTypes();
        }
    } else {
        composeFlags(node);
        composeType(node);
        noteUnmoved(*node.index);
    }
    composeClipSets(node);
    composeChildren(node, nullptr);
}

// Clips of ancestors are weaker. Those of an instance do not reach the prims of its prototype, as
// in pxr.Usd.
void StageState::composeClipSets(PrimNode& node) {
    if (!node.parent) return;
    const auto above = node.parent->clips;
    node.clips = above;
    auto definitions = composeClips(*node.index);
    if (definitions.empty()) return;
    ClipSets sets;
    for (auto& definition : definitions) {
        sets.push_back(std::make_shared<ClipSet>(std::move(definition), clipLayers));
        clipLayers->add(sets.back());
    }
    if (above) sets.insert(sets.end(), above->begin(), above->end());
    node.clips = std::make_shared<const ClipSets>(std::move(sets));
}

pxr::TfTokenVector StageState::childNames(const PrimNode& node) const {
    pxr::TfTokenVector names;
    if (!node.index || !node.has(PrimFlag::Active) || node.has(PrimFlag::Instance)) return names;
    if (node.index->GetPath().GetPathElementCount() >= kDeepest) return names;
    pxr::PcpTokenSet prohibited;
    node.index->ComputePrimChildNames(&names, &prohibited);
    const SdfPath& path = node.index->GetPath();
    composition.dropLeftOut(path, names);
    if (!mask.includesSubtree(path))
        std::erase_if(names,
                      [&](const TfToken& name) { return !mask.includes(path.AppendChild(name)); });
    return names;
}

// Keeps the nodes of prims that existed before. `only` lists the index paths of children to
// compose; other children are kept as they are unless they are new. If `only` is null, all children
// are composed.
void StageState::composeChildren(PrimNode& node, const Paths* only) {
    const auto names = childNames(node);
    const bool same =
        std::ranges::equal(names, node.children, {}, {},
                           [](const PrimNodePtr& child) { return child->path.GetNameToken(); });
    std::vector<char> isNew(names.size(), 0);
    if (!same) {
        std::unordered_map<TfToken, PrimNodePtr, TfToken::HashFunctor> before;
        for (auto& child : std::exchange(node.children, {}))
            before.emplace(child->path.GetNameToken(), std::move(child));
        node.children.reserve(names.size());
        for (std::size_t i = 0; i < names.size(); ++i) {
            const auto found = before.find(names[i]);
            if (found != before.end() && found->second) {
                node.children.push_back(std::move(found->second));
                before.erase(found);
                continue;
            }
            isNew[i] = 1;
            node.children.emplace_back(pxr::TfDelegatedCountIncrementTag,
                                       new PrimNode(this, node.path.AppendChild(names[i]), &node));
        }
        for (auto& [name, child] : before) removeLater(std::move(child));
    }
    const auto composeOne = [&](std::size_t i) {
        auto& child = *node.children[i];
        const SdfPath path = node.index->GetPath().AppendChild(names[i]);
        if (only && !isNew[i] && !only->contains(path)) return;
        child.index = composition.cache().FindPrimIndex(path);
        if (child.index) compose(child);
    };
    if (names.size() < kParallelChildren) {
        for (std::size_t i = 0; i < names.size(); ++i) composeOne(i);
    } else {
        withoutPythonLock([&] {
            pxr::WorkParallelForN(names.size(), [&](std::size_t begin, std::size_t end) {
                for (std::size_t i = begin; i < end; ++i) composeOne(i);
            });
        });
    }
    // Pcp has no index for a prim that it could not compose.
    std::erase_if(node.children, [&](PrimNodePtr& child) {
        if (child->index) return false;
        removeLater(child);
        return true;
    });
}

void StageState::composePrototype(Prototype& prototype) {
    if (!prototype.root)
        prototype.root = PrimNodePtr(pxr::TfDelegatedCountIncrementTag,
                                     new PrimNode(this, prototype.path, nullptr));
    prototype.root->index = composition.cache().FindPrimIndex(prototype.source);
    compose(*prototype.root);
}

void StageState::removeLater(PrimNodePtr node) {
    const std::scoped_lock lock(removedMutex_);
    removed_.push_back(std::move(node));
}

void StageState::detach(PrimNode& node) {
    const auto entry = nodes_.find(node.path);
    if (entry != nodes_.end() && entry->second == &node) nodes_.erase(entry);
    for (const auto& child : std::exchange(node.children, {})) detach(*child);
    node.stage = nullptr;
    node.parent = nullptr;
    node.index = nullptr;
    node.prototype = nullptr;
    node.definition = nullptr;
    node.clips = nullptr;
}

void StageState::enter(PrimNode& node) {
    nodes_[node.path] = &node;
    ++primsUpdated;
    for (const auto& child : node.children) enter(*child);
}

}  // namespace usdlive::stage
