// Finds the specs of an object inside all variants of a layer.
#include "usd/namespace/VariantSites.h"

#include <pxr/usd/sdf/primSpec.h>
#include <pxr/usd/sdf/proxyTypes.h>
#include <pxr/usd/sdf/schema.h>
#include <pxr/usd/sdf/variantSetSpec.h>
#include <pxr/usd/sdf/variantSpec.h>

#include <algorithm>
#include <string>

namespace usdlive::naming {

using pxr::SdfLayerHandle;
using pxr::SdfPath;

namespace {

// Adds `site` and all variants inside it, at any depth.
void addWithVariants(const SdfLayerHandle& layer, const SdfPath& site,
                     std::vector<SdfPath>& sites) {
    if (!layer->HasSpec(site)) return;
    sites.push_back(site);
    const auto sets = layer->GetFieldAs<std::vector<pxr::TfToken>>(
        site, pxr::SdfChildrenKeys->VariantSetChildren);
    for (const auto& set : sets) {
        const SdfPath setPath = site.AppendVariantSelection(set.GetString(), "");
        for (const auto& variant : layer->GetFieldAs<std::vector<pxr::TfToken>>(
                 setPath, pxr::SdfChildrenKeys->VariantChildren))
            addWithVariants(
                layer, site.AppendVariantSelection(set.GetString(), variant.GetString()), sites);
    }
}

}  // namespace

std::vector<SdfPath> variantSites(const SdfLayerHandle& layer, const SdfPath& object) {
    std::vector<SdfPath> sites{SdfPath::AbsoluteRootPath()};
    for (const SdfPath& prefix : object.GetPrefixes()) {
        std::vector<SdfPath> next;
        for (const SdfPath& parent : sites) {
            const SdfPath site = prefix.IsPropertyPath()
                                     ? parent.AppendProperty(prefix.GetNameToken())
                                     : parent.AppendChild(prefix.GetNameToken());
            if (prefix == object) {
                if (layer->HasSpec(site)) next.push_back(site);
            } else {
                addWithVariants(layer, site, next);
            }
        }
        sites = std::move(next);
    }
    std::erase_if(sites, [](const SdfPath& site) { return !site.ContainsPrimVariantSelection(); });
    return sites;
}

SdfPath withinVariant(const SdfPath& site, const SdfPath& to) {
    if (to.IsEmpty()) return {};
    SdfPath variant = site.GetParentPath();
    while (!variant.IsPrimVariantSelectionPath()) variant = variant.GetParentPath();
    const SdfPath owner = variant.StripAllVariantSelections();
    return to.HasPrefix(owner) && to != owner ? to.ReplacePrefix(owner, variant) : SdfPath();
}

}  // namespace usdlive::naming
