// Answers queries about one prim from its node in the tree and from its prim index.
#include "usdlive/client/usd/stage/Prim.h"

#include <pxr/base/tf/stringUtils.h>
#include <pxr/usd/pcp/composeSite.h>
#include <pxr/usd/sdf/listOp.h>
#include <pxr/usd/sdf/schema.h>

#include <algorithm>
#include <set>
#include <unordered_set>

#include "usd/stage/Opinions.h"
#include "usd/stage/StageState.h"
#include "usdlive/client/usd/schema/PrimDefinition.h"

namespace usdlive::stage {

using pxr::PcpPrimIndex;
using pxr::SdfFieldKeys;
using pxr::SdfPath;
using pxr::TfToken;
using pxr::VtValue;

Prim::Prim(PrimNode* node, SdfPath proxyPath) : proxyPath_(std::move(proxyPath)) {
    if (node) node_ = PrimNodePtr(pxr::TfDelegatedCountIncrementTag, node);
}

bool Prim::isValid() const { return node_ && node_->stage; }

Stage& Prim::stage() const { return node_->stage->stage; }

SdfPath Prim::path() const {
    if (!node_) return {};
    return isInstanceProxy() ? proxyPath_ : node_->path;
}

TfToken Prim::name() const { return path().GetNameToken(); }

Prim Prim::parent() const {
    if (!isValid() || !node_->parent) return {};
    if (!isInstanceProxy()) return {node_->parent, SdfPath()};
    const SdfPath above = proxyPath_.GetParentPath();
    // The parent of a prototype's top prims, seen as instance proxies, is the instance.
    if (!node_->parent->parent) return node_->stage->prim(above);
    return {node_->parent, above};
}

std::uint16_t Prim::flags() const { return node_->flags; }

Prim Prim::prototype() const {
    if (!isInstance() || !node_->prototype) return {};
    return {node_->prototype->root.get(), SdfPath()};
}

const PcpPrimIndex& Prim::primIndex() const {
    static const PcpPrimIndex none;
    return has(PrimFlag::PrototypeRoot) || !node_->index ? none : *node_->index;
}

pxr::SdfSpecifier Prim::specifier() const {
    return node_->parent ? composeSpecifier(primIndex()) : pxr::SdfSpecifierDef;
}

TfToken Prim::typeName() const { return node_->typeName; }

TfToken Prim::kind() const {
    TfToken kind;
    forEachSite(primIndex(), TfToken(), [&](const Site& site) {
        return !site.layer->HasField(site.path, SdfFieldKeys->Kind, &kind);
    });
    return kind;
}

const pxr::TfTokenVector& Prim::authoredSchemas() const { return node_->apiSchemas; }
const pxr::TfTokenVector& Prim::appliedSchemas() const { return definition().appliedSchemas(); }
const schema::PrimDefinition& Prim::definition() const { return *node_->definition; }

std::vector<VariantSet> Prim::variantSets() const {
    const auto& index = primIndex();
    std::vector<std::string> names;
    const bool none = forEachSite(index, TfToken(), [](const Site& site) {
        return !site.layer->HasField(site.path, SdfFieldKeys->VariantSetNames);
    });
    if (none) return {};
    for (const auto& node : index.GetNodeRange())
        if (node.GetPath().IsPrimOrPrimVariantSelectionPath())
            pxr::PcpComposeSiteVariantSets(node, &names);
    std::vector<VariantSet> sets;
    for (const auto& name : names) {
        if (std::ranges::any_of(sets, [&](const auto& set) { return set.name == name; })) continue;
        VariantSet set{name, {}, {}};
        std::set<std::string> options;
        for (const auto& node : index.GetNodeRange()) {
            const SdfPath path = node.GetPath();
            if (path.IsPrimOrPrimVariantSelectionPath())
                pxr::PcpComposeSiteVariantSetOptions(node, name, &options);
            // The selection that is composed, from whichever layer it came.
            if (set.selection.empty() && node.GetArcType() == pxr::PcpArcTypeVariant &&
                path.GetVariantSelection().first == name)
                set.selection = path.GetVariantSelection().second;
        }
        set.options.assign(options.begin(), options.end());
        sets.push_back(std::move(set));
    }
    return sets;
}

std::vector<Prim> Prim::children(const PrimPredicate& predicate) const {
    std::vector<Prim> prims;
    const PrimNode* from = node_.get();
    const bool enters = predicate.instanceProxies || isInstanceProxy();
    if (isInstance()) {
        if (!enters || !from->prototype || isInsideItself()) return prims;
        from = from->prototype->root.get();
    }
    const bool proxies = isInstance() || isInstanceProxy();
    prims.reserve(from->children.size());
    for (const auto& child : from->children)
        if (predicate.matches(child->flags))
            prims.push_back({child.get(),
                             proxies ? path().AppendChild(child->path.GetNameToken()) : SdfPath()});
    return prims;
}

// An arc below an instance may lead to the instance's own prototype. A traversal that followed it
// would not end.
bool Prim::isInsideItself() const {
    for (Prim above = isInstanceProxy() ? parent() : Prim(); above; above = above.parent())
        if (above.node_->prototype == node_->prototype) return true;
    return false;
}

Prim Prim::child(const TfToken& name) const {
    if (!isValid()) return {};
    const SdfPath below = path().AppendChild(name);
    return below.IsEmpty() ? Prim() : node_->stage->prim(below);
}

pxr::TfTokenVector Prim::propertyNames(bool onlyAuthored) const {
    std::unordered_set<TfToken, TfToken::HashFunctor> known;
    pxr::TfTokenVector names, authored;
    if (!onlyAuthored) names = definition().propertyNames();
    // PcpPrimIndex::ComputePrimPropertyNames() leaves out sites below culled nodes, though values
    // come from them.
    forEachSite(primIndex(), TfToken(), [&](const Site& site) {
        pxr::TfTokenVector ofSite;
        if (site.layer->HasField(site.path, pxr::SdfChildrenKeys->PropertyChildren, &ofSite))
            authored.insert(authored.end(), ofSite.begin(), ofSite.end());
        return true;
    });
    if (authored.empty()) return names.empty() ? names : ordered(std::move(names));
    known.insert(names.begin(), names.end());
    for (auto& name : authored)
        if (known.insert(name).second) names.push_back(std::move(name));
    return ordered(std::move(names));
}

// Sorts the names in dictionary order, and moves the names that `reorder properties` lists to the
// front.
pxr::TfTokenVector Prim::ordered(pxr::TfTokenVector names) const {
    std::ranges::sort(names, pxr::TfDictionaryLessThan());
    pxr::TfTokenVector order;
    forEachSite(primIndex(), TfToken(), [&](const Site& site) {
        return !site.layer->HasField(site.path, SdfFieldKeys->PropertyOrder, &order);
    });
    auto rest = names.begin();
    for (const auto& name : order) {
        const auto found = std::find(rest, names.end(), name);
        if (found == names.end()) continue;
        std::rotate(rest, found, found + 1);
        ++rest;
    }
    return names;
}

std::vector<Property> Prim::properties(bool onlyAuthored) const {
    std::vector<Property> properties;
    for (auto& name : propertyNames(onlyAuthored)) properties.push_back({*this, std::move(name)});
    return properties;
}

Property Prim::property(const TfToken& name) const {
    if (!isValid()) return {};
    const Property property(*this, name);
    return property.isKnown() ? property : Property();
}

VtValue Prim::metadata(const TfToken& field, AssetPaths assetPaths) const {
    if (isPseudoRoot()) return metadataOfStage(field, assetPaths);
    if (field == SdfFieldKeys->Specifier) return VtValue(specifier());
    if (field == SdfFieldKeys->TypeName)
        return typeName().IsEmpty() ? VtValue() : VtValue(typeName());
    return composeField(primIndex(), TfToken(), field, mapper(), assetPaths);
}

// The stage's metadata comes from its session layer and its root layer only. Other local layers are
// ignored.
VtValue Prim::metadataOfStage(const TfToken& field, AssetPaths assetPaths) const {
    const auto& state = *node_->stage;
    const pxr::SdfLayerRefPtr session(state.unmutedSession());
    VtValue result;
    forEachSite(primIndex(), TfToken(), [&](const Site& site) {
        if (site.layer != session && site.layer != state.rootLayer) return true;
        return addWeaker(result, site, field, {}, assetPaths);
    });
    return result;
}

Metadata Prim::authoredMetadata(AssetPaths assetPaths) const {
    Metadata fields;
    const auto list = [&](const pxr::SdfLayer& layer, const SdfPath& path) {
        for (const auto& field : layer.ListFields(path))
            if (!isPrivateField(field)) fields.try_emplace(field);
    };
    if (isPseudoRoot()) {
        if (const auto session = node_->stage->unmutedSession()) list(*session, node_->path);
        list(*node_->stage->rootLayer, node_->path);
    } else {
        forEachSite(primIndex(), TfToken(), [&](const Site& site) {
            list(*site.layer, site.path);
            return true;
        });
        fields.try_emplace(SdfFieldKeys->Specifier);
    }
    for (auto& [field, value] : fields) value = metadata(field, assetPaths);
    return fields;
}

PathMapper Prim::mapper() const {
    if (!has(PrimFlag::InPrototype)) return {};
    return [map = sources()](const SdfPath& path) {
        const std::pair<SdfPath, SdfPath>* longest = nullptr;
        for (const auto& one : map)
            if (path.HasPrefix(one.first) && (!longest || one.first.GetPathElementCount() >
                                                              longest->first.GetPathElementCount()))
                longest = &one;
        return longest ? path.ReplacePrefix(longest->first, longest->second) : path;
    };
}

// Returns pairs of paths: the source of each prototype around this prim, and the path at which it
// appears from here. Paths of the instance itself belong to the prims around it.
std::vector<std::pair<SdfPath, SdfPath>> Prim::sources() const {
    std::vector<std::pair<SdfPath, SdfPath>> map;
    for (Prim at = isInstance() ? parent() : *this; at; at = at.parent()) {
        const auto* node = at.node_.get();
        const Prototype* prototype = node->prototype;
        if (node->has(PrimFlag::PrototypeRoot)) prototype = node->stage->prototypes.at(node->path);
        if (prototype) map.emplace_back(prototype->source, at.path());
    }
    return map;
}

}  // namespace usdlive::stage
