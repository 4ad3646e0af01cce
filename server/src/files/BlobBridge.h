// Moves big values between layer files and the blob store.
#pragma once

#include <mutex>

#include "project/CommitStore.h"
#include "usdlive/common/usd/ValueCodec.h"

namespace usdlive::server {

/// Stores the big values of a file in the blob store.
class BlobKeeper final : public BlobSink {
public:
    BlobKeeper(BlobStore& store, std::mutex& writing) : store_(store), writing_(writing) {}
    void keepBlob(const Hash& hash, SharedBytes bytes) override;
    /// Returns the first error, if any.
    [[nodiscard]] const Result<void>& kept() const { return kept_; }

private:
    BlobStore& store_;
    std::mutex& writing_;  // one writer at a time for a hash
    Result<void> kept_;
};

/// For comparing layers, which needs only the hashes of big values.
class BlobNames final : public BlobSink {
public:
    [[nodiscard]] bool wantsBlob(const Hash&) override { return false; }
    void keepBlob(const Hash&, SharedBytes) override {}
};

/// Provides the big values of the store for a file.
class StoredBlobs final : public BlobSource {
public:
    explicit StoredBlobs(const BlobStore& store) : store_(store) {}
    [[nodiscard]] SharedBytes blob(const Hash& hash) override;

private:
    const BlobStore& store_;
};

}  // namespace usdlive::server
