// Finds the layers and files that the fields of a layer name.
#include "usdlive/common/usd/NamedAssets.h"

#include <pxr/base/vt/array.h>
#include <pxr/base/vt/dictionary.h>
#include <pxr/usd/sdf/assetPath.h>
#include <pxr/usd/sdf/listOp.h>
#include <pxr/usd/sdf/payload.h>
#include <pxr/usd/sdf/reference.h>

#include <algorithm>
#include <vector>

namespace usdlive::usd {

namespace {

void add(const std::string& asset, std::set<std::string>& assets) {
    if (!asset.empty()) assets.insert(asset);
}

template <class Arc>
bool addArcs(const pxr::VtValue& value, std::set<std::string>& assets) {
    if (!value.IsHolding<pxr::SdfListOp<Arc>>()) return false;
    const auto& list = value.UncheckedGet<pxr::SdfListOp<Arc>>();
    for (const auto* items : {&list.GetExplicitItems(), &list.GetPrependedItems(),
                              &list.GetAppendedItems(), &list.GetAddedItems()})
        for (const Arc& arc : *items) add(arc.GetAssetPath(), assets);
    return true;
}

void addClips(const pxr::VtValue& value, std::set<std::string>& assets) {
    if (value.IsHolding<pxr::VtDictionary>()) {
        for (const auto& [key, each] : value.UncheckedGet<pxr::VtDictionary>())
            addClips(each, assets);
    } else if (value.IsHolding<pxr::SdfAssetPath>()) {
        add(value.UncheckedGet<pxr::SdfAssetPath>().GetAssetPath(), assets);
    } else if (value.IsHolding<pxr::VtArray<pxr::SdfAssetPath>>()) {
        for (const auto& asset : value.UncheckedGet<pxr::VtArray<pxr::SdfAssetPath>>())
            add(asset.GetAssetPath(), assets);
    } else if (value.IsHolding<std::string>()) {
        if (const auto& text = value.UncheckedGet<std::string>(); isTemplate(text))
            add(text, assets);
    }
}

}  // namespace

bool namesLayers(std::string_view field) {
    return field == "subLayers" || field == "references" || field == "payload";
}

bool namesClips(std::string_view field) { return field == "clips"; }

void addNamedAssets(const pxr::VtValue& value, std::set<std::string>& assets) {
    if (addArcs<pxr::SdfReference>(value, assets) || addArcs<pxr::SdfPayload>(value, assets))
        return;
    // A file of an earlier OpenUSD version may have a single payload.
    if (value.IsHolding<pxr::SdfPayload>())
        add(value.UncheckedGet<pxr::SdfPayload>().GetAssetPath(), assets);
    else if (value.IsHolding<std::vector<std::string>>())
        for (const auto& asset : value.UncheckedGet<std::vector<std::string>>()) add(asset, assets);
    else
        addClips(value, assets);
}

bool isTemplate(std::string_view asset) { return asset.find('#') != std::string_view::npos; }

bool matchesTemplate(std::string_view pattern, std::string_view path) {
    while (!pattern.empty()) {
        if (pattern.front() != '#') {
            if (path.empty() || path.front() != pattern.front()) return false;
            pattern.remove_prefix(1);
            path.remove_prefix(1);
            continue;
        }
        pattern.remove_prefix(std::min(pattern.find_first_not_of('#'), pattern.size()));
        if (path.starts_with('-')) path.remove_prefix(1);
        const auto digits = std::min(path.find_first_not_of("0123456789"), path.size());
        if (digits == 0) return false;
        path.remove_prefix(digits);
    }
    return path.empty();
}

}  // namespace usdlive::usd
