// For whoever does not look at big values.
#pragma once

#include "usdlive/common/layer/Blobs.h"

namespace usdlive {

/// Has no big values, and keeps none. Any thread.
class NoBlobs final : public BlobSource, public BlobSink {
public:
    [[nodiscard]] SharedBytes blob(const Hash& /*hash*/) override { return nullptr; }
    [[nodiscard]] bool wantsBlob(const Hash& /*hash*/) override { return false; }
    void keepBlob(const Hash& /*hash*/, SharedBytes /*bytes*/) override {}
};

}  // namespace usdlive
