#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>

#include "usdlive/server/project/CommitStore.h"

namespace usdlive::server {

struct BlobStoreOptions {
    std::uint64_t maxBytes = std::uint64_t(4) << 30;  ///< of one value; above it BlobTooLarge
    /// Below this much free space write() fails with StorageFull. Not given: 512 MiB, or 2 % of the
    /// disk if that is more.
    std::optional<std::uint64_t> minFreeBytes;
    /// Values begun and not whole yet. One more throws the one away that was longest without a
    /// part.
    std::size_t maxUnfinished = 64;
};

/// Values as files, `<folder>/ab/abcdef...`. Unfinished ones of an earlier process are thrown away.
[[nodiscard]] Result<std::unique_ptr<BlobStore>> createFileBlobStore(
    const std::filesystem::path& folder, const BlobStoreOptions& options = {});

/// Values in memory, for tests. `minFreeBytes` is not minded.
[[nodiscard]] std::unique_ptr<BlobStore> createMemoryBlobStore(
    const BlobStoreOptions& options = {});

}  // namespace usdlive::server
