#pragma once

#include <pxr/base/tf/token.h>
#include <pxr/base/vt/value.h>

#include <functional>
#include <optional>

#include "usdlive/common/layer/FieldValue.h"

namespace usdlive::usd {

/// Where the bytes of big values are (V9). Called on the thread that calls the codec.
class BlobSource {
public:
    virtual ~BlobSource() = default;
    /// nullptr: not here (yet).
    [[nodiscard]] virtual SharedBytes blob(const Hash& hash) = 0;
};
class BlobSink {
public:
    virtual ~BlobSink() = default;
    /// False: the bytes of this value are not needed. keepBlob() may be called for it all the same.
    [[nodiscard]] virtual bool wantsBlob(const Hash& /*hash*/) { return true; }
    /// Keeps the bytes of a big value, whose SHA-256 is `hash`.
    virtual void keepBlob(const Hash& hash, SharedBytes bytes) = 0;
    /// What encodeLeaf() gives for this array, if that has been found out before; its bytes are
    /// kept.
    [[nodiscard]] virtual std::optional<Value> encoded(const pxr::VtValue& /*array*/) {
        return std::nullopt;
    }
};

/// The content of a field as the protocol carries it. A leaf of at least kBigValueBytes becomes a
/// blob in `blobs`. Composite fields come apart: VtDictionary, time samples, every SdfListOp,
/// SdfVariantSelectionMap, relocates. `subLayers` with its offsets is layerSubLayers() instead.
/// ErrorCode::UnsupportedValue names the C++ type of a value that cannot be carried.
[[nodiscard]] Result<FieldValue> encodeValue(const pxr::VtValue& value, BlobSink& blobs);

/// The other way, exactly: encodeValue(decodeValue(x)) == x. `field` decides between C++ types that
/// share a form (SdfRelocatesMap or SdfRelocates). Errors: InvalidValue, and BlobNotFound when a
/// blob is not here.
[[nodiscard]] Result<pxr::VtValue> decodeValue(const pxr::TfToken& field, const FieldValue& value,
                                               BlobSource& blobs);
/// One leaf.
[[nodiscard]] Result<Value> encodeLeaf(const pxr::VtValue& value, BlobSink& blobs);
[[nodiscard]] Result<pxr::VtValue> decodeLeaf(const Value& value, BlobSource& blobs);

}  // namespace usdlive::usd
