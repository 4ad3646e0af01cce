// Access to the data of an SdfLayer.
#pragma once

#include <pxr/base/vt/value.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/layerOffset.h>

#include <typeinfo>

#include "usdlive/common/layer/LayerDocNode.h"
#include "usdlive/common/usd/SdfLayerStore.h"

namespace usdlive::usd {

// Reads and writes the data below SdfLayer, because SdfLayer::ListFields and HasField also return
// fields that each spec of a kind has by definition, even if they are not authored.

[[nodiscard]] pxr::SdfAbstractDataConstPtr layerData(const pxr::SdfLayer& layer);
/// Changes the layer's content to `data`, spec by spec, with a notice for each difference.
void setLayerData(const pxr::SdfLayerHandle& layer, pxr::SdfAbstractDataRefPtr data);
/// Exchanges the layer's data for `data` as it is, without notices.
void swapLayerData(const pxr::SdfLayerHandle& layer, pxr::SdfAbstractDataRefPtr& data);

/// Returns the field of Sdf that lists such children.
[[nodiscard]] const pxr::TfToken& childrenField(ChildList list);
/// Returns the parent as specpath::parent does: the parent of a variant is its set.
[[nodiscard]] pxr::SdfPath parentOf(const pxr::SdfPath& path);
[[nodiscard]] pxr::SdfPath childOf(const pxr::SdfPath& parent, ChildList list,
                                   const pxr::TfToken& name);

/// Returns the field's content in the layer, or nothing if it is absent.
[[nodiscard]] Result<std::optional<FieldValue>> readField(const pxr::SdfAbstractData& data,
                                                          const pxr::SdfPath& path,
                                                          const pxr::TfToken& field,
                                                          BlobSink& blobs);

/// The decoded content of a field. `subLayers` is stored in two fields of Sdf.
struct DecodedField {
    pxr::VtValue value;
    std::optional<pxr::SdfLayerOffsetVector> offsets;  ///< the content of `subLayerOffsets`
};
[[nodiscard]] Result<DecodedField> decodeField(const pxr::SdfPath& path, const pxr::TfToken& field,
                                               const FieldValue& value, BlobSource& blobs);

/// Returns InvalidValue for a wrong type in the fields that a stage reads while it composes a prim:
/// a path expression or a dictionary of them in `active` or `kind` would end the process. In all
/// other fields, Sdf and UsdStage treat a wrong type as absent.
[[nodiscard]] Result<void> checkType(const pxr::SdfPath& path, const pxr::TfToken& field,
                                     const std::type_info& type);

/// The fields of attributes and relationships whose children follow from a list op.
struct TargetFields {
    const pxr::TfToken& list;
    const pxr::TfToken& children;
    pxr::SdfSpecType childType;
};
[[nodiscard]] std::optional<TargetFields> targetFields(std::optional<SpecKind> kind,
                                                       const pxr::TfToken& field);
/// Returns the distinct paths for which such a value has children, in order.
[[nodiscard]] pxr::SdfPathVector targetsIn(const pxr::VtValue& value);

[[nodiscard]] Error within(const Error& error, const pxr::SdfPath& path, const pxr::TfToken& field);

}  // namespace usdlive::usd
