// Converts between USD values and the values of the protocol.
#pragma once

#include <pxr/base/tf/token.h>
#include <pxr/base/vt/value.h>

#include <functional>
#include <optional>

#include "usdlive/common/layer/Blobs.h"
#include "usdlive/common/layer/FieldValue.h"

namespace usdlive::usd {

/// Arrays that were encoded before.
class EncodedArrays {
public:
    virtual ~EncodedArrays() = default;
    /// Returns the result of encodeLeaf() for this array if it is known already and its bytes are
    /// stored.
    [[nodiscard]] virtual std::optional<Value> encoded(const pxr::VtValue& array) = 0;
};

/// Encodes the content of a field for the protocol. A leaf of at least kBigValueBytes becomes a
/// blob in `blobs`. Composite content is split into parts: VtDictionary, time samples, every
/// SdfListOp, SdfVariantSelectionMap, relocates. For `subLayers` with offsets use layerSubLayers()
/// instead. Error: ErrorCode::UnsupportedValue names the C++ type.
[[nodiscard]] Result<FieldValue> encodeValue(const pxr::VtValue& value, BlobSink& blobs);

/// Decodes the content of a field exactly: encodeValue(decodeValue(x)) == x. `field` selects
/// between C++ types with the same form (SdfRelocatesMap or SdfRelocates). Errors: InvalidValue,
/// and BlobNotFound if a blob is missing.
[[nodiscard]] Result<pxr::VtValue> decodeValue(const pxr::TfToken& field, const FieldValue& value,
                                               BlobSource& blobs);
/// The same for one leaf.
[[nodiscard]] Result<Value> encodeLeaf(const pxr::VtValue& value, BlobSink& blobs);
[[nodiscard]] Result<pxr::VtValue> decodeLeaf(const Value& value, BlobSource& blobs);

}  // namespace usdlive::usd
