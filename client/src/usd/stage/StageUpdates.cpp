// Updates a stage after changes of its layers, its load rules, its mask and its muted layers.
#include <pxr/usd/ar/resolverScopedCache.h>
#include <pxr/usd/pcp/changes.h>
#include <pxr/usd/pcp/dependency.h>
#include <pxr/usd/pcp/pathTranslation.h>
#include <pxr/usd/sdf/schema.h>

#include <algorithm>
#include <map>
#include <optional>
#include <utility>

#include "usd/stage/Opinions.h"
#include "usd/stage/StageState.h"

namespace usdlive::stage {

using pxr::SdfFieldKeys;
using pxr::SdfPath;
using pxr::TfToken;
using Paths = std::set<SdfPath>;

namespace {

// Returns true if `path` is one of `prefixes` or is below one of them.
bool isBelowAny(const Paths& prefixes, const SdfPath& path) {
    if (prefixes.empty()) return false;
    for (SdfPath at = path; !at.IsEmpty(); at = at.GetParentPath())
        if (prefixes.contains(at)) return true;
    return false;
}

void dropDescendants(Paths& paths) {
    for (auto at = paths.begin(); at != paths.end();) {
        const SdfPath& prefix = *at++;
        while (at != paths.end() && at->HasPrefix(prefix)) at = paths.erase(at);
    }
}

bool isClipField(const TfToken& field) {
    return field == SdfFieldKeys->Clips || field == SdfFieldKeys->ClipSets;
}

using Unmoved = std::map<SdfPath, Paths>;

// Removes specs below inactive prims or outside of the mask. They contribute to no prim.
template <class Gathered>
void dropHidden(const StageState& state, Gathered& gathered) {
    const auto isHidden = [&](const SdfPath& path) {
        return !state.find(path.GetAbsoluteRootOrPrimPath());
    };
    for (auto* paths : {&gathered.types, &gathered.properties, &gathered.assets})
        std::erase_if(*paths, isHidden);
    std::erase_if(gathered.info, [&](const auto& one) { return isHidden(one.first); });
}

// Returns true if an arc of the prim itself, and not of an ancestor, leads to the node.
bool isInDirectArc(pxr::PcpNodeRef node) {
    bool isDirect = false;
    for (; !node.IsRootNode(); node = node.GetParentNode()) {
        if (node.IsCulled()) return false;
        isDirect = isDirect || !node.IsDueToAncestor();
    }
    return isDirect;
}

// Returns what PcpPrimIndex::IsInstanceable() will return when the prim is composed again. Pcp does
// not update it when a prim at the end of an arc gets its first spec or loses its last one.
bool isInstanceable(const pxr::PcpPrimIndex& index) {
    bool instanceable = false;
    forEachSite(index, TfToken(), [&](const Site& site) {
        return !site.layer->HasField(site.path, SdfFieldKeys->Instanceable, &instanceable);
    });
    if (!instanceable) return false;
    for (const pxr::PcpNodeRef& node : index.GetNodeRange())
        if (node.HasSpecs() && node.CanContributeSpecs() && isInDirectArc(node)) return true;
    return false;
}

}  // namespace

struct StageState::Gathered {
    Paths recompose;             // whole subtrees
    Paths types;                 // only type and API schemas
    Paths properties;            // added or removed
    Paths assets;                // asset paths below may resolve to other files
    std::set<SdfPath> activity;  // changes of "active", which Pcp ignores
    std::map<SdfPath, StageChanges::Fields> info;
    Paths parents;    // parents of specs that were added or removed: their children may have a new
                      // order
    Unmoved unmoved;  // changed paths at the sources of relocates, by the paths that Pcp reports
};

// The specs of a layer that a layer stack gains or loses.
struct StageState::Exchanged {
    pxr::SdfLayerHandle layer;
    pxr::SdfChangeList specs;
    pxr::PcpLayerStackPtrVector before;  // the layer stacks that used the layer
};

// Calls `add` for each path of the stage that a spec in these layer stacks contributes to. Specs in
// a variant contribute only if the variant is selected.
template <class Add>
void StageState::forAffected(const pxr::PcpLayerStackPtrVector& stacks, const SdfPath& path,
                             Gathered& into, Add&& add) const {
    const auto& cache = composition.cache();
    for (const auto& stack : stacks) {
        if (!path.ContainsPrimVariantSelection() && get_pointer(stack) == &*cache.GetLayerStack())
            add(path);
        const auto dependencies = cache.FindSiteDependencies(
            stack, path,
            pxr::PcpDependencyTypeDirect | pxr::PcpDependencyTypeAncestral |
                pxr::PcpDependencyTypeNonVirtual | pxr::PcpDependencyTypeVirtual,
            true, false, false);
        for (const auto& dependency : dependencies) add(dependency.indexPath);
        forUnmoved(stack, path, into, add);
    }
}

// Pcp reports the targets of relocates only.
template <class Add>
void StageState::forUnmoved(const pxr::PcpLayerStackPtr& stack, const SdfPath& path, Gathered& into,
                            Add&& add) const {
    for (const SdfPath& source : unmoved_) {
        const auto* index = composition.cache().FindPrimIndex(source);
        if (!index || !index->IsValid()) continue;
        for (const pxr::PcpNodeRef& node : index->GetNodeRange()) {
            if (get_pointer(node.GetLayerStack()) != get_pointer(stack) ||
                !path.HasPrefix(node.GetPath()))
                continue;
            const SdfPath affected =
                path.ReplacePrefix(node.GetPath(), source).StripAllVariantSelections();
            add(affected);
            into.unmoved[pxr::PcpTranslatePathFromNodeToRoot(node, path)].insert(affected);
        }
    }
}

void StageState::onLayersChanged(const pxr::SdfNotice::LayersDidChange& notice) {
    if (std::this_thread::get_id() != thread_) return;
    auto& cache = composition.cache();
    Gathered gathered;
    pxr::PcpChanges changes;
    bool concerned = composition.guard(notice.GetChangeListVec(), changes);
    for (const auto& [layer, list] : notice.GetChangeListVec()) {
        const auto& stacks = cache.FindAllLayerStacksUsingLayer(layer);
        if (!layer || stacks.empty()) continue;
        concerned = true;
        gather(stacks, layer, list, gathered);
    }
    for (const auto& [layer, list] : notice.GetChangeListVec())
        for (const auto& set : clipLayers->usersOf(layer)) {
            concerned = true;
            gatherClip(*set, layer, list, gathered);
        }
    if (!concerned) return;
    changes.DidChange(&cache, notice.GetChangeListVec());
    for (const auto& [stack, change] : changes.GetLayerStackChanges()) {
        if (!change.didChangeExpressionVariables) continue;
        for (const auto& dependency :
             cache.FindSiteDependencies(stack, SdfPath::AbsoluteRootPath(),
                                        pxr::PcpDependencyTypeAnyNonVirtual, true, false, false))
            gathered.assets.insert(dependency.indexPath);
    }
    follow(changes, gathered);
}

void StageState::gather(const pxr::PcpLayerStackPtrVector& stacks, const pxr::SdfLayerHandle& layer,
                        const pxr::SdfChangeList& changes, Gathered& into) const {
    if (stacks.empty()) return;
    for (const auto& [path, entry] : changes.GetEntryList())
        if (!path.IsTargetPath()) gather(stacks, layer, path, entry, into);
}

void StageState::gather(const pxr::PcpLayerStackPtrVector& stacks, const pxr::SdfLayerHandle& layer,
                        const SdfPath& path, const pxr::SdfChangeList::Entry& entry,
                        Gathered& into) const {
    const auto add = [&](Paths& paths) {
        forAffected(stacks, path, into, [&](const SdfPath& one) { paths.insert(one); });
    };
    const auto changed = [&](auto&&... fields) {
        return std::ranges::any_of(entry.infoChanged, [&](const auto& change) {
            return ((change.first == fields) || ...);
        });
    };
    static const TfToken schemas("apiSchemas"), fallbacks("fallbackPrimTypes");
    const auto& flags = entry.flags;
    const bool cameOrWent = flags.didAddInertPrim || flags.didAddNonInertPrim ||
                            flags.didRemoveInertPrim || flags.didRemoveNonInertPrim;
    if (path.IsPrimPath() && cameOrWent)
        forAffected(stacks, path, into,
                    [&](const SdfPath& one) { into.parents.insert(one.GetParentPath()); });
    if (path.IsPrimVariantSelectionPath() && cameOrWent)
        forAffected(stacks, path.GetParentPath(), into, [&](const SdfPath& one) {
            into.info[one].insert(pxr::SdfChildrenKeys->VariantChildren);
        });
    if (path == SdfPath::AbsoluteRootPath() || path.IsPrimOrPrimVariantSelectionPath()) {
        const bool activity = changed(SdfFieldKeys->Active);
        const pxr::SdfLayerRefPtr kept(layer);
        const bool ofStage = path == SdfPath::AbsoluteRootPath() &&
                             (kept == rootLayer || kept == sessionLayer) && changed(fallbacks);
        const bool recomposes = activity || entry.flags.didReorderChildren || ofStage ||
                                changed(SdfFieldKeys->Kind, SdfFieldKeys->Specifier) ||
                                std::ranges::any_of(entry.infoChanged, [](const auto& change) {
                                    return isClipField(change.first);
                                });
        if (activity) add(into.activity);
        if (recomposes) return add(into.recompose);
        if (changed(SdfFieldKeys->TypeName, schemas)) add(into.types);
    } else if (path.IsPropertyPath() &&
               (entry.flags.didAddPropertyWithOnlyRequiredFields || entry.flags.didAddProperty ||
                entry.flags.didRemovePropertyWithOnlyRequiredFields ||
                entry.flags.didRemoveProperty)) {
        return add(into.properties);
    }
    StageChanges::Fields fields;
    for (const auto& change : entry.infoChanged) fields.insert(change.first);
    if (entry.flags.didChangeAttributeTimeSamples) fields.insert(SdfFieldKeys->TimeSamples);
    if (entry.flags.didChangeAttributeConnection) fields.insert(SdfFieldKeys->ConnectionPaths);
    if (entry.flags.didChangeRelationshipTargets) fields.insert(SdfFieldKeys->TargetPaths);
    forAffected(stacks, path, into,
                [&](const SdfPath& one) { into.info[one].insert(fields.begin(), fields.end()); });
}

// Other samples of a clip change values of the prims that use the clip. Pcp does not know clips.
void StageState::gatherClip(ClipSet& set, const pxr::SdfLayerHandle& layer,
                            const pxr::SdfChangeList& changes, Gathered& into) const {
    set.onLayerChanged();
    for (const auto& [path, entry] : changes.GetEntryList()) {
        const auto& flags = entry.flags;
        if (path == SdfPath::AbsoluteRootPath() &&
            (flags.didReplaceContent || flags.didReloadContent)) {
            forAffected({set.definition().stack}, set.definition().prim, into,
                        [&](const SdfPath& one) { into.properties.insert(one); });
            continue;
        }
        const SdfPath changed = set.fromClip(path);
        if (changed.IsEmpty()) continue;
        if (path.IsPropertyPath() && set.mayShow(layer, changed))
            forAffected({set.definition().stack}, changed, into, [&](const SdfPath& one) {
                into.info[one].insert(SdfFieldKeys->TimeSamples);
            });
        else if (flags.didAddNonInertPrim || flags.didRemoveNonInertPrim || flags.didRename)
            forAffected({set.definition().stack}, changed, into,
                        [&](const SdfPath& one) { into.properties.insert(one); });
    }
}

// Pcp reports the specs of layers that are muted, unmuted, or added to and removed from sublayers,
// unless all prims are composed again. Specs that come are found after the composition follows, and
// specs that go before.
std::vector<StageState::Exchanged> StageState::gatherLeaving(const pxr::PcpChanges& changes,
                                                             Gathered& into) const {
    const auto& cache = composition.cache();
    std::vector<Exchanged> exchanged;
    for (const auto& [changed, change] : changes.GetCacheChanges()) {
        if (changed != &cache) continue;
        for (const auto& [layer, specs] : change.layerChangeListVec)
            if (layer)
                exchanged.push_back({layer, specs, cache.FindAllLayerStacksUsingLayer(layer)});
    }
    const auto& ofStacks = changes.GetLayerStackChanges();
    for (const auto& one : exchanged) {
        auto leaving = one.before;
        std::erase_if(leaving, [&](const auto& stack) {
            const auto change = ofStacks.find(stack);
            return change == ofStacks.end() || !change->second.didChangeLayers;
        });
        gather(leaving, one.layer, one.specs, into);
    }
    return exchanged;
}

void StageState::gatherComing(const std::vector<Exchanged>& exchanged, Gathered& into) {
    auto& cache = composition.cache();
    for (const auto& [layer, specs, before] : exchanged) {
        auto coming = cache.FindAllLayerStacksUsingLayer(layer);
        std::erase_if(coming, [&](const auto& stack) {
            return std::ranges::find(before, stack) != before.end();
        });
        gather(coming, layer, specs, into);
    }
}

void StageState::follow(pxr::PcpChanges& changes, Gathered& gathered) {
    const auto exchanged = gatherLeaving(changes, gathered);
    for (const auto& path : gathered.activity)
        changes.DidChangeSignificantly(&composition.cache(), path);
    composeUnmoved(gathered, changes);
    const double timesBefore = composition.localLayers().GetTimeCodesPerSecond();
    composition.apply(changes);
    if (!exchanged.empty()) {
        gathered.activity.clear();
        gatherComing(exchanged, gathered);
        pxr::PcpChanges coming;
        for (const auto& path : gathered.activity)
            coming.DidChangeSignificantly(&composition.cache(), path);
        composition.apply(coming);
    }
    // Pcp does not notice that a session layer with other time codes is muted or unmuted.
    if (composition.localLayers().GetTimeCodesPerSecond() != timesBefore) {
        pxr::PcpChanges all;
        all.DidChangeSignificantly(&composition.cache(), SdfPath::AbsoluteRootPath());
        composition.apply(all);
        gathered.recompose.insert(SdfPath::AbsoluteRootPath());
    }
    for (const auto& [cache, change] : changes.GetCacheChanges()) {
        if (cache != &composition.cache()) continue;
        gathered.recompose.insert(change.didChangeSignificantly.begin(),
                                  change.didChangeSignificantly.end());
        gathered.recompose.insert(change.didChangePrims.begin(), change.didChangePrims.end());
        becomeInstances(change.didChangeSpecs, gathered.recompose);
    }
    recompose(gathered.recompose);
    reorder(gathered);
    moveToPrototypes(gathered);
    dropHidden(*this, gathered);

    StageChanges reported;
    std::erase_if(gathered.types,
                  [&](const SdfPath& one) { return isBelowAny(gathered.recompose, one); });
    for (const auto& path : gathered.types)
        if (auto* node = find(path); node && node->parent) composeType(*node);
    reported.resynced = std::move(gathered.recompose);
    reported.resynced.merge(gathered.types);
    reported.resynced.merge(gathered.properties);
    dropDescendants(reported.resynced);
    for (auto& [path, fields] : gathered.info)
        if (!isBelowAny(reported.resynced, path))
            reported.changedInfo.emplace(path, std::move(fields));
    dropDescendants(gathered.assets);
    for (const auto& path : gathered.assets)
        if (!isBelowAny(reported.resynced, path)) reported.assetPathsResynced.insert(path);
    if (!reported.isEmpty()) notify(reported);
}

// Composes the sources of relocates again if Pcp composes their targets again.
void StageState::composeUnmoved(const Gathered& gathered, pxr::PcpChanges& changes) const {
    if (gathered.unmoved.empty()) return;
    Paths composed;
    for (const auto& [cache, change] : changes.GetCacheChanges()) {
        if (cache != &composition.cache()) continue;
        for (const auto& [target, sources] : gathered.unmoved)
            if (isBelowAny(
                    {change.didChangeSignificantly.begin(), change.didChangeSignificantly.end()},
                    target) ||
                change.didChangePrims.contains(target) || change.didChangeSpecs.contains(target))
                composed.insert(sources.begin(), sources.end());
    }
    for (const auto& path : composed)
        if (path.IsPrimPath()) changes.DidChangeSignificantly(&composition.cache(), path);
}

// A new spec at the end of an arc can make a prim an instance, or an instance of another prototype.
// Pcp reports only a change of specs, but the prims below an instance must be composed differently.
void StageState::becomeInstances(const pxr::SdfPathSet& withOtherSpecs, Paths& recompose) {
    pxr::PcpChanges changes;
    for (const auto& path : withOtherSpecs) {
        const auto* node = path.IsPrimPath() ? shownBy(path) : nullptr;
        const auto* index = node ? composition.cache().FindPrimIndex(path) : nullptr;
        if (!index || isBelowAny(recompose, path)) continue;
        const bool instance = node->has(PrimFlag::Active) && isInstanceable(*index);
        auto* prototype = prototypes.of(path);
        if (instance ? prototype && hasArcsOf(*prototype, *index) : !prototype) continue;
        changes.DidChangeSignificantly(&composition.cache(), path);
        recompose.insert(path);
    }
    composition.apply(changes);
}

// Returns true if the prototype is the one of a prim index. A prototype keeps its prims if the key
// of all its instances has changed in the same way.
bool StageState::hasArcsOf(Prototype& prototype, const pxr::PcpPrimIndex& index) {
    const pxr::PcpInstanceKey arcs(index);
    if (prototype.key.arcs == arcs) return true;
    const bool all = std::ranges::all_of(prototype.instances, [&](const SdfPath& path) {
        const auto* other = composition.cache().FindPrimIndex(path);
        return other && pxr::PcpInstanceKey(*other) == arcs;
    });
    return all && prototypes.rekey(prototype, {arcs, prototype.key.load, prototype.key.mask,
                                               prototype.key.clips});
}

bool StageState::isComposed(const SdfPath& path) const {
    if (!path.IsAbsoluteRootOrPrimPath() || path.ContainsPrimVariantSelection()) return false;
    if (!mask.includes(path)) return false;
    const auto* around = prototypes.around(path);
    return !around || path.HasPrefix(around->source);
}

PrimNode* StageState::shownBy(const SdfPath& index) const {
    const auto* around = prototypes.around(index);
    if (!around) return find(index);
    if (around->source.IsEmpty() || !index.HasPrefix(around->source)) return nullptr;
    return find(index.ReplacePrefix(around->source, around->path));
}

// `resynced` contains paths of prim indexes. Adds the paths of prototypes' prims that were composed
// again.
void StageState::recompose(Paths& resynced) {
    if (resynced.empty()) return;
    dropDescendants(resynced);
    Paths hidden;  // had no prim before, and may still have none
    for (const auto& path : resynced)
        if (!shownBy(path)) hidden.insert(path);
    pxr::SdfPathVector roots;
    std::set<Prototype*> changed;
    for (const auto& path : resynced)
        if (isComposed(path)) roots.push_back(path);
    for (const auto& path : roots) {
        for (auto* prototype : prototypes.sourcedUnder(path)) changed.insert(prototype);
        prototypes.forget(path);
    }
    // This is needed without roots too, because assignSources() must assign new sources.
    composeIndexes(roots, changed);
    const auto unused = prototypes.takeUnused();
    for (const auto& prototype : unused) changed.erase(prototype.get());

    // Siblings are composed together, so that the children of their parent are listed once.
    std::map<PrimNode*, Paths> below;
    for (const auto& path : roots) {
        if (path == SdfPath::AbsoluteRootPath()) {
            compose(*root);
            enter(*root);
        } else if (changed.contains(prototypes.around(path))) {
            continue;  // the whole prototype is composed again below
        } else if (auto* parent = shownBy(path.GetParentPath()); parent) {
            // The children of an instance belong to its prototype.
            if (parent->has(PrimFlag::Instance)) {
                if (!parent->prototype || parent->prototype->source != path.GetParentPath())
                    continue;
                parent = parent->prototype->root.get();
            }
            if (parent) below[parent].insert(path);
        }
    }
    for (const auto& [parent, paths] : below) {
        // Pcp may have moved the parent's index.
        parent->index = composition.cache().FindPrimIndex(paths.begin()->GetParentPath());
        if (!parent->stage || !parent->index) continue;
        composeChildren(*parent, &paths);
        for (const auto& child : parent->children)
            if (paths.contains(child->index->GetPath()) || !nodes_.contains(child->path)) {
                enter(*child);
                resynced.insert(child->path);
            }
    }
    for (auto* prototype : changed) {
        composePrototype(*prototype);
        enter(*prototype->root);
        resynced.insert(prototype->path);
    }
    for (const auto& prototype : unused) {
        resynced.insert(prototype->path);
        if (prototype->root) detach(*prototype->root);
    }
    for (const auto& node : std::exchange(removed_, {})) detach(*node);
    for (const auto& path : hidden)
        if (!shownBy(path)) resynced.erase(path);
    dropDescendants(resynced);
}

// A spec without arcs and content composes no prim again, but it may change the order of siblings.
void StageState::reorder(Gathered& gathered) {
    for (const auto& path : gathered.parents) {
        if (isBelowAny(gathered.recompose, path)) continue;
        auto* node = shownBy(path);
        if (auto* prototype = prototypes.of(path); prototype && prototype->source == path)
            node = prototype->root.get();
        if (!node) continue;
        node->index = composition.cache().FindPrimIndex(path);
        if (!node->index) continue;
        const auto namesOf = [](const std::vector<PrimNodePtr>& children) {
            pxr::TfTokenVector names;
            for (const auto& child : children) names.push_back(child->path.GetNameToken());
            return names;
        };
        auto before = namesOf(node->children);
        if (childNames(*node) == before) continue;
        const Paths none;
        composeChildren(*node, &none);
        for (const auto& child : node->children)
            if (!nodes_.contains(child->path)) enter(*child);
        auto after = namesOf(node->children);
        const auto resync = [&](pxr::TfTokenVector& names, const pxr::TfTokenVector& others) {
            const std::set<TfToken> kept(others.begin(), others.end());
            std::erase_if(names, [&](const TfToken& name) {
                if (!kept.contains(name)) gathered.recompose.insert(path.AppendChild(name));
                return !kept.contains(name);
            });
        };
        const auto all = before;
        resync(before, after);
        resync(after, all);
        if (before != after) gathered.info[path].insert(pxr::SdfChildrenKeys->PrimChildren);
    }
    for (const auto& node : std::exchange(removed_, {})) detach(*node);
}

// Replaces paths inside instances by those of the prototype's prims.
void StageState::moveToPrototypes(Gathered& gathered) const {
    if (prototypes.all().empty()) return;
    const auto moved = [this](const SdfPath& path) -> std::optional<SdfPath> {
        const SdfPath prim = path.GetAbsoluteRootOrPrimPath();
        const auto* around = prototypes.around(prim);
        if (!around) return path;
        if (!prim.HasPrefix(around->source)) return std::nullopt;
        return path.ReplacePrefix(around->source, around->path);
    };
    for (auto* paths :
         {&gathered.recompose, &gathered.types, &gathered.properties, &gathered.assets}) {
        Paths result;
        for (const auto& path : *paths)
            if (const auto at = moved(path)) result.insert(*at);
        *paths = std::move(result);
    }
    std::map<SdfPath, StageChanges::Fields> info;
    for (auto& [path, fields] : gathered.info)
        if (const auto at = moved(path)) info[*at].merge(fields);
    gathered.info = std::move(info);
}

void StageState::setLoadRules(const LoadRules& rules) {
    if (rules == load) return;
    load = rules;
    auto& cache = composition.cache();
    pxr::SdfPathSet include, exclude;
    cache.ForEachPrimIndex([&](const pxr::PcpPrimIndex& index) {
        if (!index.HasAnyPayloads()) return;
        const bool loads = load.isLoaded(index.GetPath());
        if (loads != cache.IsPayloadIncluded(index.GetPath()))
            (loads ? include : exclude).insert(index.GetPath());
    });
    pxr::PcpChanges changes;
    composition.guardPayloads(include, changes);
    cache.RequestPayloads(include, exclude, &changes);
    Gathered gathered;
    // Load rules decide which prims may share a prototype.
    for (const auto& prototype : prototypes.all()) {
        Paths others;
        for (const auto& instance : prototype->instances)
            if (!(prototype->key.load == load.below(instance))) others.insert(instance);
        if (others.empty()) continue;
        const auto rules = load.below(*others.begin());
        const bool all = std::ranges::all_of(prototype->instances, [&](const SdfPath& instance) {
            return load.below(instance) == rules;
        });
        if (all && prototypes.rekey(*prototype, {prototype->key.arcs, rules, prototype->key.mask,
                                                 prototype->key.clips}))
            continue;
        gathered.recompose.merge(others);
    }
    follow(changes, gathered);
}

void StageState::setMask(const PopulationMask& wanted) {
    if (wanted == mask) return;
    mask = wanted;
    Gathered gathered;
    gathered.recompose.insert(SdfPath::AbsoluteRootPath());
    pxr::PcpChanges none;
    follow(none, gathered);
}

// Pcp reports a session layer that is muted or unmuted only if it has prims.
void StageState::gatherSession(Gathered& into) const {
    static const TfToken fallbacks("fallbackPrimTypes");
    const auto& path = SdfPath::AbsoluteRootPath();
    const bool isMuted = std::ranges::find(muted, sessionLayer->GetIdentifier()) != muted.end();
    if (isMuted != bool(unmutedSession())) return;
    into.parents.insert(path);
    for (const auto& field : sessionLayer->ListFields(path)) {
        if (isPrivateField(field) ||
            sessionLayer->GetField(path, field) == rootLayer->GetField(path, field))
            continue;
        into.info[path].insert(field);
        if (field == fallbacks) into.recompose.insert(path);
    }
}

void StageState::setMuted(const std::vector<std::string>& identifiers) {
    pxr::PcpChanges changes;
    composition.setMuted(identifiers, changes);
    muted = identifiers;
    Gathered gathered;
    gatherSession(gathered);
    follow(changes, gathered);
}

Stage::Subscription StageState::subscribe(Stage::Listener listener) {
    auto kept = std::make_shared<Stage::Listener>(std::move(listener));
    std::erase_if(listeners_, [](const auto& one) { return one.expired(); });
    listeners_.push_back(kept);
    return kept;
}

void StageState::notify(const StageChanges& changes) {
    // A listener may subscribe another listener. The new one is first called after the next change.
    for (const auto& listener : std::vector(listeners_))
        if (const auto kept = listener.lock()) (*kept)(changes);
}

}  // namespace usdlive::stage
