#pragma once

#include <pxr/base/vt/value.h>
#include <pxr/usd/pcp/node.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/layerOffset.h>
#include <pxr/usd/sdf/path.h>

#include <cstddef>
#include <cstdint>

namespace usdlive::stage {

/// A place that a composed value comes from: a spec in one layer of the layer stack of a node.
struct ValueSite {
    pxr::PcpNodeRef node;
    std::size_t layerIndex = 0;  ///< in the node's layer stack
    pxr::SdfPath path;           ///< of the spec in its layer

    [[nodiscard]] const pxr::SdfLayerRefPtr& layer() const;
    /// From times of the layer to those of the stage: the offset of the layer in its layer stack,
    /// then those of all arcs on the way to the root.
    [[nodiscard]] pxr::SdfLayerOffset layerToStage() const;
};

/// How paths of files read on the stage: with the file that they were resolved to, or, to be
/// written into another layer, as identifiers that do not depend on the layer.
enum class AssetPaths : std::uint8_t { Resolved, Anchored };

/// A value of a layer as it reads on the stage: time codes are offset, asset paths are resolved
/// relative to the layer with variable expressions evaluated, paths in path expressions are those
/// of the stage. The same for each part of an array or a dictionary; other values are returned as
/// they are.
[[nodiscard]] pxr::VtValue toStage(const pxr::VtValue& value, const ValueSite& site,
                                   AssetPaths assetPaths = AssetPaths::Resolved);

}  // namespace usdlive::stage
