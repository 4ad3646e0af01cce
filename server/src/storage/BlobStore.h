// Creates stores for big values.
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>

#include "project/CommitStore.h"

namespace usdlive::server {

struct BlobStoreOptions {
    /// The limit of one value. A larger one gives BlobTooLarge.
    std::uint64_t maxBytes = std::uint64_t(4) << 30;
    /// write() fails with StorageFull if less than this is free. Not set: 512 MiB, or 2 % of the
    /// disk if that is more.
    std::optional<std::uint64_t> minFreeBytes;
    /// The most values that may be incomplete. Starting one more drops the one whose last part is
    /// the oldest, of writers that have left; if none has, of the writer with the most,
    /// in the share with the most.
    std::size_t maxUnfinished = 64;
    /// The incomplete values of writers that have left (forget()) are kept for others that continue
    /// them: for this time, and at most so many bytes of them.
    std::chrono::milliseconds keepLeft = std::chrono::minutes(15);
    std::uint64_t maxLeftBytes = std::uint64_t(4) << 30;
};

/// Stores values as files, `<folder>/ab/abcdef...`. Deletes incomplete values of an earlier
/// process.
[[nodiscard]] Result<std::unique_ptr<BlobStore>> createFileBlobStore(
    const std::filesystem::path& folder, const BlobStoreOptions& options = {});

/// Stores values in memory, for tests. Ignores `minFreeBytes`.
[[nodiscard]] std::unique_ptr<BlobStore> createMemoryBlobStore(
    const BlobStoreOptions& options = {});

}  // namespace usdlive::server
