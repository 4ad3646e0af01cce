// The source and the sink of big values.
#pragma once

#include "usdlive/common/core/Bytes.h"
#include "usdlive/common/core/Hash.h"

namespace usdlive {

namespace usd {
class EncodedArrays;
}

/// Provides the bytes of big values (V9). Called on the thread that asks for a value.
class BlobSource {
public:
    virtual ~BlobSource() = default;
    /// Returns nullptr if the bytes are not available (yet).
    [[nodiscard]] virtual SharedBytes blob(const Hash& hash) = 0;
};

/// Takes the bytes of big values. Called on the thread that encodes a value.
class BlobSink {
public:
    virtual ~BlobSink() = default;
    /// Returns false if the bytes of this value are not needed. keepBlob() may still be called.
    [[nodiscard]] virtual bool wantsBlob(const Hash& /*hash*/) { return true; }
    /// Stores the bytes of a big value. Their SHA-256 is `hash`.
    virtual void keepBlob(const Hash& hash, SharedBytes bytes) = 0;
    /// Returns the arrays that are encoded already, or nullptr.
    [[nodiscard]] virtual usd::EncodedArrays* encodedArrays() { return nullptr; }
};

}  // namespace usdlive
