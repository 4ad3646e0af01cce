// The opinions on a prim or property, strong to weak, and their values as the stage sees them.
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
    std::size_t layerIndex;  // in the layer stack of the node
    const pxr::SdfLayerRefPtr& layer;
    const pxr::SdfPath& path;
};

/// Calls `visit` for each site, strong to weak, until it returns false. `property`: empty for the
/// prim.
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

/// Maps a path of the prim index to one of the stage: for prims of prototypes, and of instances.
using PathMapper = std::function<pxr::SdfPath(const pxr::SdfPath&)>;

/// Maps the paths of path expressions, inside arrays and dictionaries too.
void mapPaths(pxr::VtValue& value, const PathMapper& mapPath);

/// Whether a field describes the structure of a spec, and is no metadata.
[[nodiscard]] bool isPrivateField(const pxr::TfToken& field);

/// Adds the opinion of a weaker site to `result`, which is empty before the strongest. Returns
/// whether weaker ones can still add to it.
bool addWeaker(pxr::VtValue& result, const Site& site, const pxr::TfToken& field,
               const PathMapper& mapPath, AssetPaths assetPaths);

/// One field, composed: dictionaries and path expressions of all sites are merged, list operations
/// applied, and of all else the strongest counts. Empty: no site has it.
[[nodiscard]] pxr::VtValue composeField(const pxr::PcpPrimIndex& index,
                                        const pxr::TfToken& property, const pxr::TfToken& field,
                                        const PathMapper& mapPath, AssetPaths assetPaths);

/// The specifier of a prim: "def", else "class", else "over"; a class that is inherited makes no
/// class.
[[nodiscard]] pxr::SdfSpecifier composeSpecifier(const pxr::PcpPrimIndex& index);
[[nodiscard]] pxr::TfToken composeTypeName(const pxr::PcpPrimIndex& index);
/// API schemas, the list operations of all sites applied.
[[nodiscard]] pxr::TfTokenVector composeApiSchemas(const pxr::PcpPrimIndex& index);

}  // namespace usdlive::stage
