// Declares EditTarget, which maps paths and times of a stage to the layer that is edited.
#pragma once

#include <pxr/usd/pcp/mapFunction.h>
#include <pxr/usd/pcp/node.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/path.h>

namespace usdlive::stage {

/// The layer that edits are written to, and the mapping from paths and times of the stage to those
/// of the layer. A value: cheap to copy. It does not keep the layer in memory.
class EditTarget {
public:
    /// Creates an invalid target.
    EditTarget() = default;
    /// Targets a local layer. `offset` maps times of the layer to times of the stage.
    explicit EditTarget(const pxr::SdfLayerHandle& layer,
                        const pxr::SdfLayerOffset& offset = pxr::SdfLayerOffset());
    /// Targets a layer behind an arc, with the mapping of `node`. The target reaches the node's
    /// prim and the prims below it.
    EditTarget(const pxr::SdfLayerHandle& layer, const pxr::PcpNodeRef& node);
    /// Targets the inside of a variant in a local layer. `variant` has the form "/Prim{set=name}".
    [[nodiscard]] static EditTarget inVariant(const pxr::SdfLayerHandle& layer,
                                              const pxr::SdfPath& variant);

    [[nodiscard]] bool isValid() const { return bool(layer_); }
    [[nodiscard]] const pxr::SdfLayerHandle& layer() const { return layer_; }
    [[nodiscard]] const pxr::PcpMapFunction& mapping() const { return mapping_; }

    /// Returns the path in the layer, or an empty path if the target does not reach `stagePath`.
    [[nodiscard]] pxr::SdfPath specPath(const pxr::SdfPath& stagePath) const;
    /// Returns the prim's spec in the layer. Creates the spec and its ancestors if they are
    /// missing. Returns null if the target does not reach the path, or if the layer may not be
    /// edited.
    [[nodiscard]] pxr::SdfPrimSpecHandle primSpec(const pxr::SdfPath& stagePath) const;
    /// Converts a time of the stage to a time of the layer.
    [[nodiscard]] double layerTime(double stageTime) const;

    bool operator==(const EditTarget&) const = default;

private:
    EditTarget(const pxr::SdfLayerHandle& layer, pxr::PcpMapFunction mapping);

    pxr::SdfLayerHandle layer_;
    pxr::PcpMapFunction mapping_;
};

}  // namespace usdlive::stage
