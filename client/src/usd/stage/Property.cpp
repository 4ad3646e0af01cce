// Answers queries about one property from its prim's index and from its schema definition.
#include "usdlive/client/usd/stage/Property.h"

#include <pxr/usd/pcp/propertyIndex.h>
#include <pxr/usd/pcp/targetIndex.h>
#include <pxr/usd/sdf/listOp.h>
#include <pxr/usd/sdf/schema.h>

#include <algorithm>

#include "usd/content/PathListItems.h"
#include "usd/stage/DepthGuard.h"
#include "usd/stage/Opinions.h"
#include "usd/stage/StageState.h"
#include "usdlive/client/usd/schema/PrimDefinition.h"

namespace usdlive::stage {

using pxr::SdfFieldKeys;
using pxr::SdfPath;
using pxr::TfToken;
using pxr::VtValue;

namespace {

const TfToken& targetsField(bool ofAttribute) {
    return ofAttribute ? SdfFieldKeys->ConnectionPaths : SdfFieldKeys->TargetPaths;
}

// Returns true if a target is too deep for Pcp, which compares and maps it.
bool hasDeepTargets(const pxr::PcpPrimIndex& index, const TfToken& property, bool ofAttribute) {
    return !forEachSite(index, property, [&](const Site& site) {
        pxr::SdfPathListOp targets;
        if (!site.layer->HasField(site.path, targetsField(ofAttribute), &targets)) return true;
        bool isDeep = false;
        content::forEachPath(targets, [&](const SdfPath& target) {
            isDeep = isDeep || isTooDeep(target.GetPrimPath());
        });
        return !isDeep;
    });
}

}  // namespace

const schema::PropertyDefinition* Property::definition() const {
    return prim_.definition().property(name_);
}

bool Property::isKnown() const { return !name_.IsEmpty() && (definition() || isAuthored()); }

bool Property::isAuthored() const {
    return !forEachSite(prim_.primIndex(), name_,
                        [](const Site& site) { return !site.layer->HasSpec(site.path); });
}

pxr::SdfSpecType Property::specType() const {
    if (const auto* known = definition())
        return known->isAttribute ? pxr::SdfSpecTypeAttribute : pxr::SdfSpecTypeRelationship;
    auto type = pxr::SdfSpecTypeUnknown;
    forEachSite(prim_.primIndex(), name_, [&](const Site& site) {
        type = site.layer->GetSpecType(site.path);
        return type == pxr::SdfSpecTypeUnknown;
    });
    return type;
}

bool Property::isAttribute() const { return specType() == pxr::SdfSpecTypeAttribute; }

bool Property::isCustom() const {
    if (definition()) return false;
    return !forEachSite(prim_.primIndex(), name_, [](const Site& site) {
        bool custom = false;
        return !site.layer->HasField(site.path, SdfFieldKeys->Custom, &custom) || !custom;
    });
}

TfToken Property::typeName() const {
    if (const auto* known = definition()) return known->typeName;
    TfToken type;
    forEachSite(prim_.primIndex(), name_, [&](const Site& site) {
        return !site.layer->HasField(site.path, SdfFieldKeys->TypeName, &type);
    });
    return type;
}

// The weakest opinion decides, so that an attribute that varies in a weak layer stays varying.
pxr::SdfVariability Property::variability() const {
    if (const auto* known = definition()) return known->variability;
    auto variability = pxr::SdfVariabilityVarying;
    forEachSite(prim_.primIndex(), name_, [&](const Site& site) {
        auto one = pxr::SdfVariabilityVarying;
        if (site.layer->HasField(site.path, SdfFieldKeys->Variability, &one)) variability = one;
        return true;
    });
    return variability;
}

AttributeQuery Property::query(AssetPaths assetPaths) const {
    return {prim_.primIndex(),     name_,      definition(),
            Interpolation::Linear, assetPaths, prim_.node_->clips};
}

VtValue Property::value(std::optional<double> time) const { return value(query(), time); }

VtValue Property::value(const AttributeQuery& query, std::optional<double> time) const {
    auto value = time ? query.get(*time) : query.getDefault();
    if (const auto map = prim_.mapper()) mapPaths(value, map);
    return value;
}

pxr::SdfPathVector Property::targets() const {
    const auto& index = prim_.primIndex();
    if (!index.IsValid() || hasDeepTargets(index, name_, isAttribute())) return {};
    const auto& cache = prim_.stage().composition().cache();
    const pxr::PcpSite site(cache.GetLayerStackIdentifier(), path());
    pxr::PcpPropertyIndex properties;
    pxr::PcpTargetIndex found;
    pxr::PcpErrorVector errors;
    pxr::PcpBuildPrimPropertyIndex(site.path, cache, index, &properties, &errors);
    pxr::PcpBuildTargetIndex(site, properties, specType(), &found, &errors);
    if (const auto map = prim_.mapper())
        for (auto& target : found.paths) target = map(target);
    std::erase_if(found.paths, [](const SdfPath& target) { return target.IsEmpty(); });
    return std::move(found.paths);
}

bool Property::hasAuthoredTargets() const {
    const auto& field = targetsField(isAttribute());
    return !forEachSite(prim_.primIndex(), name_,
                        [&](const Site& site) { return !site.layer->HasField(site.path, field); });
}

VtValue Property::metadata(const TfToken& field, AssetPaths assetPaths) const {
    if (field == SdfFieldKeys->Custom) return VtValue(isCustom());
    if (isAttribute()) {
        if (field == SdfFieldKeys->TypeName) return VtValue(typeName());
        if (field == SdfFieldKeys->Variability) return VtValue(variability());
    }
    return composeField(prim_.primIndex(), name_, field, prim_.mapper(), assetPaths);
}

Metadata Property::authoredMetadata(AssetPaths assetPaths) const {
    Metadata fields;
    forEachSite(prim_.primIndex(), name_, [&](const Site& site) {
        for (const auto& field : site.layer->ListFields(site.path))
            if (!isPrivateField(field)) fields.try_emplace(field);
        return true;
    });
    for (const auto& field : {SdfFieldKeys->Custom, SdfFieldKeys->Variability})
        fields.try_emplace(field);
    if (isAttribute()) fields.try_emplace(SdfFieldKeys->TypeName);
    for (auto& [field, value] : fields) value = metadata(field, assetPaths);
    return fields;
}

}  // namespace usdlive::stage
