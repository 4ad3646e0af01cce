// Declares ValueSite, the spec that a composed value comes from, and the mapping of its values to
// the stage.
#pragma once

#include <pxr/base/vt/value.h>
#include <pxr/usd/pcp/node.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/layerOffset.h>
#include <pxr/usd/sdf/path.h>

#include <cstddef>
#include <cstdint>

namespace usdlive::stage {

/// The source of a composed value: a spec in one layer of a node's layer stack. Valid until the
/// prim index changes.
struct ValueSite {
    pxr::PcpNodeRef node;
    std::size_t layerIndex = 0;  ///< the index in the node's layer stack
    pxr::SdfPath path;           ///< the path of the spec in its layer
    /// The layer of the value clip that the value comes from; null for all other values. Its times
    /// are times of the stage.
    pxr::SdfLayerRefPtr clip = {};

    [[nodiscard]] const pxr::SdfLayerRefPtr& layer() const;
    /// Returns the offset that maps times of the layer to times of the stage. It combines the
    /// layer's offset in its layer stack with the offsets of all arcs up to the root.
    [[nodiscard]] pxr::SdfLayerOffset layerToStage() const;
};

/// The form of asset paths in returned values. Resolved adds the resolved file path. Anchored
/// returns identifiers that do not depend on the layer, so that they can be written into another
/// layer.
enum class AssetPaths : std::uint8_t { Resolved, Anchored };

/// Maps a layer's value to the stage. Applies the layer offset to time codes, evaluates expressions
/// in asset paths and resolves them relative to the layer, and maps paths in path expressions. Maps
/// the elements of arrays and dictionaries in the same way. Returns other values unchanged.
[[nodiscard]] pxr::VtValue toStage(const pxr::VtValue& value, const ValueSite& site,
                                   AssetPaths assetPaths = AssetPaths::Resolved);

}  // namespace usdlive::stage
