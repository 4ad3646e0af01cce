// Finds the layers that a layer uses.
#include "usd/UsedLayers.h"

#include <pxr/usd/sdf/payload.h>
#include <pxr/usd/sdf/reference.h>
#include <pxr/usd/sdf/schema.h>

namespace usdlive::client {

namespace {

template <class Arc>
void addAssets(const pxr::SdfLayerHandle& layer, const pxr::SdfPath& path,
               const pxr::TfToken& field, std::set<std::string>& assets) {
    pxr::VtValue value;
    if (!layer->HasField(path, field, &value)) return;
    const auto add = [&](const std::vector<Arc>& arcs) {
        for (const Arc& arc : arcs)
            if (!arc.GetAssetPath().empty()) assets.insert(arc.GetAssetPath());
    };
    // A file of an earlier OpenUSD version may have a single payload.
    if (value.IsHolding<Arc>()) return add({value.UncheckedGet<Arc>()});
    if (!value.IsHolding<pxr::SdfListOp<Arc>>()) return;
    const auto& list = value.UncheckedGet<pxr::SdfListOp<Arc>>();
    add(list.GetExplicitItems());
    add(list.GetPrependedItems());
    add(list.GetAppendedItems());
    add(list.GetAddedItems());
}

}  // namespace

std::set<std::string> usedAssets(const pxr::SdfLayerHandle& layer, LoadSet load) {
    std::set<std::string> assets;
    for (const std::string& sub : layer->GetSubLayerPaths()) assets.insert(sub);
    layer->Traverse(pxr::SdfPath::AbsoluteRootPath(), [&](const pxr::SdfPath& path) {
        if (!path.IsPrimPath() && !path.IsPrimVariantSelectionPath()) return;
        addAssets<pxr::SdfReference>(layer, path, pxr::SdfFieldKeys->References, assets);
        if (load == LoadSet::All)
            addAssets<pxr::SdfPayload>(layer, path, pxr::SdfFieldKeys->Payload, assets);
    });
    return assets;
}

}  // namespace usdlive::client
