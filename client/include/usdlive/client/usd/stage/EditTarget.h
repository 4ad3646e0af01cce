#pragma once

#include <pxr/usd/pcp/mapFunction.h>
#include <pxr/usd/pcp/node.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/path.h>

namespace usdlive::stage {

/// Where edits of a stage are written: a layer, and how paths and times of the stage become its
/// own.
class EditTarget {
public:
    EditTarget() = default;
    /// A local layer. `offset`: from the layer's time to the stage's.
    explicit EditTarget(const pxr::SdfLayerHandle& layer,
                        const pxr::SdfLayerOffset& offset = pxr::SdfLayerOffset());
    /// The layer at the other end of an arc, as it contributes to the prims at and below the
    /// node's.
    EditTarget(const pxr::SdfLayerHandle& layer, const pxr::PcpNodeRef& node);
    /// Inside a variant of a local layer. `variant`: "/Prim{set=name}".
    [[nodiscard]] static EditTarget inVariant(const pxr::SdfLayerHandle& layer,
                                              const pxr::SdfPath& variant);

    [[nodiscard]] bool isValid() const { return bool(layer_); }
    [[nodiscard]] const pxr::SdfLayerHandle& layer() const { return layer_; }
    [[nodiscard]] const pxr::PcpMapFunction& mapping() const { return mapping_; }

    /// The path in the layer. Empty: the target does not reach this part of the stage.
    [[nodiscard]] pxr::SdfPath specPath(const pxr::SdfPath& stagePath) const;
    /// The prim's spec, created together with its ancestors where they are missing. Null: the
    /// target does not reach the path, or the layer may not be edited.
    [[nodiscard]] pxr::SdfPrimSpecHandle primSpec(const pxr::SdfPath& stagePath) const;
    /// A time of the stage, as the layer counts it.
    [[nodiscard]] double layerTime(double stageTime) const;

    bool operator==(const EditTarget&) const = default;

private:
    EditTarget(const pxr::SdfLayerHandle& layer, pxr::PcpMapFunction mapping);

    pxr::SdfLayerHandle layer_;
    pxr::PcpMapFunction mapping_;
};

}  // namespace usdlive::stage
