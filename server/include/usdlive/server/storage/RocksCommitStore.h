#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>

#include "usdlive/server/project/CommitStore.h"

namespace usdlive::server {

enum class Durability {
    Synced,           ///< append() returns after fsync: what it took survives a power cut
    OperatingSystem,  ///< survives the end of the process, not that of the machine
};

struct RocksCommitStoreOptions {
    Durability durability = Durability::Synced;
    /// Below this much free space on the disk hasSpace() is false. Not given: 512 MiB, or 2 % of
    /// the disk if that is more.
    std::optional<std::uint64_t> minFreeBytes;
    /// A file that is deleted when the disk is full, so that RocksDB can finish what it had begun.
    std::uint64_t reserveBytes = 8 * 1024 * 1024;
    /// How long opening may take to verify the hash chain, newest commits first. What is older than
    /// it gets to is verified when it is read.
    std::chrono::milliseconds verifyTime{2'000};
};

/// Opens the store in `folder`, or makes one. Takes the next epoch, durably, before anything else.
///
/// A store of an older format is brought up to date, which an older server cannot read any more.
/// Errors: StorageLocked (another process or store has it open), StorageTooNew, StorageCorrupt
/// (what is there is not all that was acknowledged; nothing was changed), StorageFull (too full to
/// open), StorageFailed. Its destructor may take as long as a write to the disk does.
[[nodiscard]] Result<std::unique_ptr<CommitStore>> createRocksCommitStore(
    const std::filesystem::path& folder, const RocksCommitStoreOptions& options = {});

}  // namespace usdlive::server
