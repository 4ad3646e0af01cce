// Finds the layers that a layer uses.
#include "usd/places/UsedLayers.h"

#include <pxr/usd/sdf/schema.h>

#include "usdlive/common/usd/NamedAssets.h"

namespace usdlive::client {

std::set<std::string> usedAssets(const pxr::SdfLayerHandle& layer, LoadSet load) {
    std::set<std::string> assets;
    for (const std::string& sub : layer->GetSubLayerPaths()) assets.insert(sub);
    layer->Traverse(pxr::SdfPath::AbsoluteRootPath(), [&](const pxr::SdfPath& path) {
        if (!path.IsPrimPath() && !path.IsPrimVariantSelectionPath()) return;
        usd::addNamedAssets(layer->GetField(path, pxr::SdfFieldKeys->References), assets);
        if (load == LoadSet::All)
            usd::addNamedAssets(layer->GetField(path, pxr::SdfFieldKeys->Payload), assets);
    });
    return assets;
}

}  // namespace usdlive::client
