// Finds arcs and texts that are too deep for OpenUSD.
#include "usd/stage/DepthGuard.h"

#include <pxr/base/work/loops.h>
#include <pxr/usd/ar/packageUtils.h>
#include <pxr/usd/ar/resolvedPath.h>
#include <pxr/usd/ar/resolver.h>
#include <pxr/usd/ar/resolverContextBinder.h>
#include <pxr/usd/sdf/fileFormat.h>
#include <pxr/usd/sdf/layerUtils.h>
#include <pxr/usd/sdf/listOp.h>
#include <pxr/usd/sdf/payload.h>
#include <pxr/usd/sdf/reference.h>
#include <pxr/usd/sdf/schema.h>
#include <pxr/usd/sdf/types.h>
#include <pxr/usd/sdf/variableExpression.h>

#include <algorithm>
#include <deque>
#include <utility>

#include "usd/content/PathListItems.h"
#include "usd/stage/PythonLock.h"
#include "usdlive/common/usd/TextDepth.h"
#include "usdlive/common/usd/TfComplaints.h"

namespace usdlive::stage {

using pxr::SdfFieldKeys;
using pxr::SdfLayer;
using pxr::SdfLayerHandle;
using pxr::SdfPath;
using pxr::SdfPathVector;
using pxr::TfToken;

namespace {

// Composition reads no spec deeper than this: an arc leads to a path of kDeepestPath elements, and
// composes as many levels below it.
constexpr std::size_t kDeepestSpec = 2 * kDeepestPath;

pxr::ArResolvedPath resolvedFile(const std::string& identifier) {
    auto& resolver = pxr::ArGetResolver();
    auto path = resolver.Resolve(identifier);
    if (path.empty()) return path;
    const auto format = pxr::SdfFileFormat::FindByExtension(path.GetPathString());
    if (!format || !format->IsPackage()) return path;
    return pxr::ArResolvedPath(pxr::ArJoinPackageRelativePath(
        path.GetPathString(), format->GetPackageRootLayerPath(path.GetPathString())));
}

// Returns a message if the file of a layer is a text that is nested too deeply. The layers of a
// server need no check: their paths have at most 1,024 elements (PA1).
std::string problemOfText(const std::string& identifier) {
    if (SdfLayer::IsAnonymousLayerIdentifier(identifier)) return {};
    if (identifier.find("://") != std::string::npos) return {};
    const auto path = resolvedFile(identifier);
    const std::string why = path.empty() ? std::string() : usd::whyTooDeep(path);
    return why.empty() ? why : "cannot open the layer '" + identifier + "': " + why;
}

// Returns the number of elements and the first of them, for paths of any length.
std::string describeDeep(const SdfPath& path) {
    constexpr std::size_t kShown = 8;
    std::deque<SdfPath> first;
    std::size_t elements = 0;
    for (SdfPath at = path; at != SdfPath::AbsoluteRootPath() && !at.IsEmpty();
         at = at.GetParentPath()) {
        ++elements;
        first.push_back(at);
        if (first.size() > kShown) first.pop_front();
    }
    return "a path with " + std::to_string(elements) + " elements that begins with <" +
           (first.empty() ? std::string() : first.front().GetString()) + ">; at most " +
           std::to_string(kDeepestPath) + " are composed";
}

TfToken rootName(const SdfPath& path) {
    if (!path.IsAbsolutePath()) return {};
    SdfPath top;
    for (SdfPath at = path; at != SdfPath::AbsoluteRootPath() && !at.IsEmpty();
         at = at.GetParentPath())
        top = at;
    return top.IsEmpty() ? TfToken() : top.GetNameToken();
}

// Returns true if the spec of the prim in this layer selects the variant.
bool isSelected(const SdfLayer& layer, const SdfPath& prim, const std::string& set,
                const std::string& variant) {
    pxr::SdfVariantSelectionMap selections;
    if (!layer.HasField(prim, SdfFieldKeys->VariantSelection, &selections)) return false;
    const auto selection = selections.find(set);
    return selection != selections.end() && selection->second == variant;
}

bool isLayerFile(const std::string& asset) {
    const auto extension = SdfLayer::IsAnonymousLayerIdentifier(asset)
                               ? std::string("usd")
                               : pxr::SdfFileFormat::GetFileExtension(asset);
    return extension.starts_with("usd") && asset.find(":SDF_FORMAT_ARGS:") == std::string::npos;
}

// Returns true if an entry may change arcs by more than new names of specs.
bool changesArcs(const SdfPath& path, const pxr::SdfChangeList::Entry& entry) {
    const auto& flags = entry.flags;
    if (flags.didReplaceContent || flags.didReloadContent || flags.didAddNonInertPrim ||
        flags.didAddInertPrim || flags.didRemoveNonInertPrim || flags.didRemoveInertPrim)
        return true;
    if (!entry.subLayerChanges.empty()) return true;
    if (path != SdfPath::AbsoluteRootPath() && !path.IsPrimOrPrimVariantSelectionPath())
        return false;
    return std::ranges::any_of(entry.infoChanged, [](const auto& change) {
        const auto& field = change.first;
        return field == SdfFieldKeys->References || field == SdfFieldKeys->Payload ||
               field == SdfFieldKeys->InheritPaths || field == SdfFieldKeys->Specializes ||
               field == SdfFieldKeys->LayerRelocates || field == SdfFieldKeys->SubLayers ||
               field == SdfFieldKeys->VariantSelection || field == SdfFieldKeys->DefaultPrim;
    });
}

}  // namespace

bool isTooDeep(const SdfPath& path) {
    if (!path.IsAbsolutePath()) return false;
    const std::size_t elements = path.GetPathElementCount();
    if (elements > kDeepestPath) return true;
    SdfPath at = path;
    for (std::size_t i = 0; i < elements; ++i) at = at.GetParentPath();
    return !at.IsEmpty() && at != SdfPath::AbsoluteRootPath();
}

Result<pxr::SdfLayerRefPtr> openLayer(const std::string& identifier) {
    if (auto open = SdfLayer::Find(identifier)) return pxr::SdfLayerRefPtr(open);
    if (auto problem = problemOfText(identifier); !problem.empty())
        return fail(ErrorCode::LayerUnreadable, std::move(problem));
    usd::TfComplaints complaints;
    if (auto layer = SdfLayer::FindOrOpen(identifier)) {
        complaints.pass();
        return layer;
    }
    return fail(ErrorCode::LayerUnreadable, "cannot open the layer '" + identifier +
                                                "': " + complaints.text("there is no such file"));
}

struct DepthGuard::Arc {
    SdfPath spec;
    TfToken field;
    std::string asset;  // empty for an arc inside the layer stack
    SdfPath target;
    bool isSelected = true;  // false in a variant that its layer does not select
};

struct DepthGuard::Wanted {
    SdfLayerHandle layer;  // names the asset
    std::string asset;
    bool local;
};

struct DepthGuard::Scan {
    std::map<SdfPath, std::string> deep;
    std::set<std::string> subLayers, assets;
};

// Calls `visit` for each arc of a prim at or below `subtree`, and for sublayers and relocates.
template <class Visit>
void DepthGuard::forEachArc(const SdfLayer& layer, const SdfPath& subtree, Visit&& visit) {
    struct Place {
        SdfPath path;
        std::size_t depth;
        bool isSelected;
    };
    std::vector<Place> open{{subtree, 0, true}};
    const auto eachItem = [&]<class ListOp>(const Place& place, const TfToken& field, ListOp list) {
        if (!layer.HasField(place.path, field, &list)) return;
        if constexpr (std::is_same_v<ListOp, pxr::SdfPathListOp>)
            content::forEachPath(list, [&](const SdfPath& path) {
                visit(Arc{place.path, field, {}, path, place.isSelected});
            });
        else
            for (const auto& item : list.GetAppliedItems())
                visit(Arc{place.path, field, item.GetAssetPath(), item.GetPrimPath(),
                          place.isSelected});
    };
    while (!open.empty()) {
        const Place place = std::move(open.back());
        open.pop_back();
        if (place.path == SdfPath::AbsoluteRootPath()) {
            std::vector<std::string> subLayers;
            if (layer.HasField(place.path, SdfFieldKeys->SubLayers, &subLayers))
                for (const auto& asset : subLayers)
                    visit(Arc{place.path, SdfFieldKeys->SubLayers, asset, {}});
            pxr::SdfRelocates relocates;
            if (layer.HasField(place.path, SdfFieldKeys->LayerRelocates, &relocates))
                for (const auto& [from, to] : relocates) {
                    visit(Arc{to, SdfFieldKeys->LayerRelocates, {}, from});
                    visit(Arc{from, SdfFieldKeys->LayerRelocates, {}, to});
                }
        } else {
            eachItem(place, SdfFieldKeys->References, pxr::SdfReferenceListOp());
            eachItem(place, SdfFieldKeys->Payload, pxr::SdfPayloadListOp());
            eachItem(place, SdfFieldKeys->InheritPaths, pxr::SdfPathListOp());
            eachItem(place, SdfFieldKeys->Specializes, pxr::SdfPathListOp());
        }
        if (place.depth > kDeepestSpec) continue;
        pxr::TfTokenVector names;
        if (layer.HasField(place.path, pxr::SdfChildrenKeys->PrimChildren, &names))
            for (const auto& name : names)
                open.push_back({place.path.AppendChild(name), place.depth + 1, place.isSelected});
        if (!layer.HasField(place.path, pxr::SdfChildrenKeys->VariantSetChildren, &names)) continue;
        for (const auto& set : names) {
            pxr::TfTokenVector variants;
            layer.HasField(place.path.AppendVariantSelection(set, ""),
                           pxr::SdfChildrenKeys->VariantChildren, &variants);
            for (const auto& variant : variants)
                open.push_back({place.path.AppendVariantSelection(set, variant), place.depth + 1,
                                place.isSelected && isSelected(layer, place.path, set, variant)});
        }
    }
}

DepthGuard::Scan DepthGuard::scan(const SdfLayer& layer, const SdfPath& subtree, bool payloads) {
    Scan result;
    forEachArc(layer, subtree, [&](const Arc& arc) {
        if (arc.field == SdfFieldKeys->SubLayers) {
            result.subLayers.insert(arc.asset);
            return;
        }
        if (isTooDeep(arc.target))
            result.deep.try_emplace(isTooDeep(arc.spec) ? SdfPath::AbsoluteRootPath() : arc.spec,
                                    "the field '" + arc.field.GetString() + "' of <" +
                                        (isTooDeep(arc.spec) ? "/" : arc.spec.GetString()) +
                                        "> in the layer @" + layer.GetIdentifier() + "@ leads to " +
                                        describeDeep(arc.target));
        if (!arc.asset.empty() && arc.isSelected &&
            (payloads || arc.field != SdfFieldKeys->Payload))
            result.assets.insert(arc.asset);
    });
    return result;
}

DepthGuard::DepthGuard(SdfLayerHandle root, SdfLayerHandle session, Layers layers)
    : root_(std::move(root)), session_(std::move(session)), layers_(layers) {}

void DepthGuard::take(const SdfLayerHandle& layer, bool local, Scan scan,
                      std::vector<Wanted>& wave) {
    checked_[layer] |= local;
    if (!scan.deep.empty()) {
        deep_[layer].layer = layer;
        deep_[layer].messages.merge(scan.deep);
    }
    for (const auto& asset : scan.subLayers) wave.push_back({layer, asset, local});
    for (const auto& asset : scan.assets) wave.push_back({layer, asset, false});
}

// Opens and checks layers, then the layers that these name, and so on.
void DepthGuard::follow(std::vector<Wanted> wave, Opened& opened) {
    struct Found {
        std::string identifier;
        pxr::SdfLayerRefPtr layer;
        bool local = false, isNew = false;
        std::string problem;
        Scan scan;
    };
    while (!wave.empty()) {
        std::map<std::string, Found> byIdentifier;
        for (const auto& [anchor, asset, local] : wave) {
            if (asset.empty() || pxr::SdfVariableExpression::IsExpression(asset)) continue;
            auto identifier = pxr::SdfComputeAssetPathRelativeToLayer(anchor, asset);
            if (unused_.contains(identifier)) continue;
            byIdentifier[std::move(identifier)].local |= local;
        }
        std::vector<Found> found;
        for (auto& [identifier, one] : byIdentifier) {
            one.identifier = identifier;
            found.push_back(std::move(one));
        }
        // A context is bound to a thread.
        const auto context = pxr::ArGetResolver().GetCurrentContext();
        const auto look = [&](std::size_t begin, std::size_t end) {
            const pxr::ArResolverContextBinder binder(context);
            for (std::size_t i = begin; i < end; ++i) {
                auto& one = found[i];
                // Pcp reports the layers that cannot be opened.
                const usd::TfComplaints complaints;
                one.layer = SdfLayer::Find(one.identifier);
                if (!one.layer && layers_ == Layers::Open && isLayerFile(one.identifier)) {
                    one.problem = problemOfText(one.identifier);
                    if (one.problem.empty()) one.layer = SdfLayer::FindOrOpen(one.identifier);
                }
                const auto known = one.layer ? checked_.find(one.layer) : checked_.end();
                // A layer that becomes local has sublayers that become local.
                one.isNew = one.layer && (known == checked_.end() || (one.local && !known->second));
                if (one.isNew) one.scan = scan(*one.layer, SdfPath::AbsoluteRootPath(), payloads_);
            }
        };
        // Layers that are open already are found at once.
        if (layers_ == Layers::FindOnly)
            look(0, found.size());
        else
            withoutPythonLock([&] { pxr::WorkParallelForN(found.size(), look); });
        wave.clear();
        for (auto& one : found) {
            if (!one.problem.empty()) texts_[one.identifier] = one.problem;
            if (!one.isNew) continue;
            if (layers_ == Layers::Open) opened.push_back(one.layer);
            take(one.layer, one.local, std::move(one.scan), wave);
        }
    }
}

bool DepthGuard::checkAll(const std::set<std::string>& unused, bool payloads, Opened& opened) {
    unused_ = unused;
    payloads_ = payloads;
    checked_.clear();
    deep_.clear();
    texts_.clear();
    std::vector<Wanted> wave;
    for (const auto& layer : {session_, root_})
        if (layer) take(layer, true, scan(*layer, SdfPath::AbsoluteRootPath(), payloads_), wave);
    follow(std::move(wave), opened);
    return decide();
}

bool DepthGuard::check(const pxr::SdfLayerChangeListVec& changes,
                       const std::function<bool(const SdfLayerHandle&)>& isUsed, Opened& opened) {
    std::vector<Wanted> wave;
    bool isScanned = false;
    for (const auto& [layer, list] : changes) {
        if (!layer) continue;
        const auto known = checked_.find(layer);
        SdfPathVector changed;
        if (known != checked_.end()) {
            // Sdf keeps the paths before a rename for other changes of the same notice, so renames
            // count if arcs change, too.
            bool areRenames = !deep_.contains(layer) && leftOut_.empty();
            for (const auto& [path, entry] : list.GetEntryList()) {
                const bool isArc = changesArcs(path, entry);
                if (isArc || entry.flags.didRename) changed.push_back(path);
                areRenames = areRenames && !isArc;
            }
            if (changed.empty() || areRenames) continue;
            // It may remove an arc that is too deep, or add one to a prim that is left out.
            if (deep_.contains(layer) || !leftOut_.empty())
                return checkAll(std::set(unused_), payloads_, opened);
            SdfPath::RemoveDescendentPaths(&changed);
        } else if (isUsed(layer)) {
            changed.push_back(SdfPath::AbsoluteRootPath());
        }
        const bool isLocal = known != checked_.end() && known->second;
        for (const SdfPath& path : changed) {
            if (!layer->HasSpec(path)) continue;
            take(layer, isLocal, scan(*layer, path, payloads_), wave);
            isScanned = true;
        }
    }
    follow(std::move(wave), opened);
    return isScanned && decide();
}

bool DepthGuard::checkPayloads(const std::vector<std::pair<SdfLayerHandle, SdfPath>>& specs,
                               Opened& opened) {
    std::vector<Wanted> wave;
    for (const auto& [layer, path] : specs) {
        pxr::SdfPayloadListOp payloads;
        if (!layer->HasField(path, SdfFieldKeys->Payload, &payloads)) continue;
        for (const auto& payload : payloads.GetAppliedItems())
            if (!payload.GetAssetPath().empty())
                wave.push_back({layer, payload.GetAssetPath(), false});
    }
    const bool before = std::exchange(payloads_, true);
    follow(std::move(wave), opened);
    payloads_ = before;
    return decide();
}

bool DepthGuard::leavesOut(const SdfPath& prim) const {
    return !leftOut_.empty() && leftOut_.contains(rootName(prim));
}

// Updates what is left out. Returns true if it changed.
bool DepthGuard::decide() {
    const auto leftOut = std::exchange(leftOut_, {});
    const auto muted = std::exchange(muted_, {});
    problems_.clear();
    if (!deep_.empty() || !texts_.empty()) leaveOut();
    return leftOut != leftOut_ || muted != muted_;
}

// Returns true if an arc of a local layer leads to a prim that is left out.
bool DepthGuard::leadsOut(const SdfLayerHandle& layer, const Arc& arc, bool classesLeadOut) const {
    if (arc.asset.empty()) {
        const SdfPath target = arc.target.IsEmpty() ? root_->GetDefaultPrimAsPath() : arc.target;
        return leftOut_.contains(rootName(target));
    }
    if (classesLeadOut) return true;
    const auto other = SdfLayer::Find(pxr::SdfComputeAssetPathRelativeToLayer(layer, arc.asset));
    const auto known = other ? checked_.find(other) : checked_.end();
    return known != checked_.end() && known->second && deep_.contains(other);
}

// Leaves out layers behind arcs as a whole, and root prims of local layers with all root prims that
// use them.
void DepthGuard::leaveOut() {
    const auto mute = [this](const std::string& identifier, const std::string& message) {
        if (std::ranges::find(muted_, identifier) == muted_.end()) muted_.push_back(identifier);
        problems_.push_back(
            {"ArcTooDeep", SdfPath::AbsoluteRootPath(), message + ". The layer is left out"});
    };
    for (const auto& [identifier, message] : texts_) {
        muted_.push_back(identifier);
        problems_.push_back({"TextTooDeep", SdfPath::AbsoluteRootPath(), message});
    }
    for (const auto& [layer, deep] : deep_) {
        for (const auto& [spec, message] : deep.messages) {
            const auto name = rootName(spec);
            if (!checked_[layer] || name.IsEmpty()) {
                if (layer != root_) mute(layer->GetIdentifier(), message);
                continue;
            }
            leftOut_.insert(name);
            problems_.push_back({"ArcTooDeep", SdfPath::AbsoluteRootPath().AppendChild(name),
                                 message + ". <" + name.GetString() + "> is not composed"});
        }
    }
    for (bool more = !leftOut_.empty(); more;) {
        more = false;
        // Classes of a layer behind an arc are also looked for in the local layers.
        bool classesLeadOut = false;
        for (const auto& [layer, local] : checked_) {
            if (!layer || local) continue;
            forEachArc(*layer, SdfPath::AbsoluteRootPath(), [&](const Arc& arc) {
                const bool isClass = arc.field == SdfFieldKeys->InheritPaths ||
                                     arc.field == SdfFieldKeys->Specializes;
                if (isClass && leftOut_.contains(rootName(arc.target))) classesLeadOut = true;
                if (!isClass && !arc.asset.empty() && leadsOut(layer, arc, false) &&
                    std::ranges::find(muted_, layer->GetIdentifier()) == muted_.end())
                    mute(layer->GetIdentifier(), "an arc of <" + arc.spec.GetString() +
                                                     "> in the layer @" + layer->GetIdentifier() +
                                                     "@ leads to the layer @" + arc.asset +
                                                     "@, which has arcs that are too deep");
            });
        }
        for (const auto& [layer, local] : checked_) {
            if (!layer || !local) continue;
            forEachArc(*layer, SdfPath::AbsoluteRootPath(), [&](const Arc& arc) {
                const auto name = rootName(arc.spec);
                if (name.IsEmpty() || leftOut_.contains(name) ||
                    !leadsOut(layer, arc, classesLeadOut))
                    return;
                leftOut_.insert(name);
                problems_.push_back({"ArcTooDeep", SdfPath::AbsoluteRootPath().AppendChild(name),
                                     "<" + name.GetString() + "> is not composed: the field '" +
                                         arc.field.GetString() + "' of <" + arc.spec.GetString() +
                                         "> in the layer @" + layer->GetIdentifier() +
                                         "@ leads to a prim that is not composed"});
                more = true;
            });
        }
    }
}

}  // namespace usdlive::stage
