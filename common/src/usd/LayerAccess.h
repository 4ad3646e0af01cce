#pragma once

#include <pxr/base/vt/value.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/layerOffset.h>

#include <typeinfo>

#include "usdlive/common/layer/LayerDocNode.h"
#include "usdlive/common/usd/SdfLayerStore.h"

namespace usdlive::usd {

// What a layer holds, below SdfLayer: SdfLayer::ListFields and HasField also tell of fields that
// every spec of a kind has by definition, authored or not.

[[nodiscard]] pxr::SdfAbstractDataConstPtr layerData(const pxr::SdfLayer& layer);
/// Turns the layer's content into `data`'s, spec by spec, telling of each difference.
void setLayerData(const pxr::SdfLayerHandle& layer, pxr::SdfAbstractDataRefPtr data);
/// Gives the layer `data` for its own, as it is, and tells nobody.
void swapLayerData(const pxr::SdfLayerHandle& layer, pxr::SdfAbstractDataRefPtr& data);

/// The field that lists the children.
[[nodiscard]] const pxr::TfToken& childrenField(ChildList list);
/// As specpath::parent: a variant's is its set.
[[nodiscard]] pxr::SdfPath parentOf(const pxr::SdfPath& path);
[[nodiscard]] pxr::SdfPath childOf(const pxr::SdfPath& parent, ChildList list,
                                   const pxr::TfToken& name);

/// The field as the layer holds it; nothing when absent.
[[nodiscard]] Result<std::optional<FieldValue>> readField(const pxr::SdfAbstractData& data,
                                                          const pxr::SdfPath& path,
                                                          const pxr::TfToken& field,
                                                          BlobSink& blobs);

/// What a field is set to. `subLayers` is two fields of Sdf.
struct DecodedField {
    pxr::VtValue value;
    std::optional<pxr::SdfLayerOffsetVector> offsets;  ///< goes to `subLayerOffsets`
};
[[nodiscard]] Result<DecodedField> decodeField(const pxr::SdfPath& path, const pxr::TfToken& field,
                                               const FieldValue& value, BlobSource& blobs);

/// InvalidValue for the fields that a stage reads while it composes a prim: with a path expression
/// or a dictionary of them in `active` or `kind` it ends the process. Of all others, Sdf and
/// UsdStage take wrong types for absent.
[[nodiscard]] Result<void> checkType(const pxr::SdfPath& path, const pxr::TfToken& field,
                                     const std::type_info& type);

/// Attributes and relationships have children that follow from a list op.
struct TargetFields {
    const pxr::TfToken& list;
    const pxr::TfToken& children;
    pxr::SdfSpecType childType;
};
[[nodiscard]] std::optional<TargetFields> targetFields(std::optional<SpecKind> kind,
                                                       const pxr::TfToken& field);
/// The paths that such a value gives children for, in order, each once.
[[nodiscard]] pxr::SdfPathVector targetsIn(const pxr::VtValue& value);

[[nodiscard]] Error within(const Error& error, const pxr::SdfPath& path, const pxr::TfToken& field);

}  // namespace usdlive::usd
