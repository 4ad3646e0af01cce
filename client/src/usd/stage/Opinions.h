// Declares functions that read the opinions on a prim or property, from strong to weak, and compose
// them.
#pragma once

#include <pxr/base/vt/value.h>
#include <pxr/usd/pcp/layerStack.h>
#include <pxr/usd/pcp/node.h>
#include <pxr/usd/pcp/primIndex.h>
#include <pxr/usd/sdf/layer.h>

#include <functional>

#include "usdlive/client/usd/stage/ValueSite.h"

namespace usdlive::stage {

/// A place where a prim or property may have a spec.
struct Site {
    const pxr::PcpNodeRef& node;
    std::size_t layerIndex;  // the index in the node's layer stack
    const pxr::SdfLayerRefPtr& layer;
    const pxr::SdfPath& path;
};

/// Calls `visit` for each site from strong to weak until it returns false. Returns false in that
/// case. An empty `property` selects the sites of the prim itself.
template <class Visit>
bool forEachSite(const pxr::PcpPrimIndex& index, const pxr::TfToken& property, Visit&& visit) {
    if (!index.IsValid()) return true;
    for (const pxr::PcpNodeRef& node : index.GetNodeRange()) {
        if (node.IsInert() || !node.HasSpecs()) continue;
        const pxr::SdfPath path =
            property.IsEmpty() ? node.GetPath() : node.GetPath().AppendProperty(property);
        const auto& layers = node.GetLayerStack()->GetLayers();
        for (std::size_t i = 0; i < layers.size(); ++i)
            if (!visit(Site{node, i, layers[i], path})) return false;
    }
    return true;
}

/// Maps a path of the prim index to a path of the stage. It is needed for prims of prototypes and
/// instances.
using PathMapper = std::function<pxr::SdfPath(const pxr::SdfPath&)>;

/// Maps the paths in path expressions, also inside arrays and dictionaries.
void mapPaths(pxr::VtValue& value, const PathMapper& mapPath);

/// Returns true if the field describes the structure of a spec and is therefore not metadata.
[[nodiscard]] bool isPrivateField(const pxr::TfToken& field);

/// Adds the opinion of a weaker site to `result`. `result` is empty before the strongest site.
/// Returns true if weaker opinions can still change the result.
bool addWeaker(pxr::VtValue& result, const Site& site, const pxr::TfToken& field,
               const PathMapper& mapPath, AssetPaths assetPaths);

/// Returns one composed field. Dictionaries and path expressions of all sites are merged, and list
/// operations are applied. For other types the strongest opinion is returned. Returns an empty
/// value if no site has the field.
[[nodiscard]] pxr::VtValue composeField(const pxr::PcpPrimIndex& index,
                                        const pxr::TfToken& property, const pxr::TfToken& field,
                                        const PathMapper& mapPath, AssetPaths assetPaths);

/// Returns the specifier of a prim: "def" before "class" before "over". A class that the prim
/// inherits from does not make it a class.
[[nodiscard]] pxr::SdfSpecifier composeSpecifier(const pxr::PcpPrimIndex& index);
[[nodiscard]] pxr::TfToken composeTypeName(const pxr::PcpPrimIndex& index);
/// Returns the API schemas after the list operations of all sites.
[[nodiscard]] pxr::TfTokenVector composeApiSchemas(const pxr::PcpPrimIndex& index);

}  // namespace usdlive::stage
