// Stores a project's history in RocksDB.
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>

#include "project/CommitStore.h"

namespace usdlive::server {

enum class Durability {
    Synced,           ///< append() returns after fsync: commits survive a power cut
    OperatingSystem,  ///< commits survive the end of the process, but not a power cut
};

struct RocksCommitStoreOptions {
    Durability durability = Durability::Synced;
    /// hasSpace() is false if less than this is free on the disk. Not set: 512 MiB, or 2 % of the
    /// disk if that is more.
    std::optional<std::uint64_t> minFreeBytes;
    /// The size of a file that is deleted when the disk is full, so that RocksDB can finish its
    /// current work.
    std::uint64_t reserveBytes = 8 * 1024 * 1024;
    /// The time limit for verifying the hash chain at opening, newest commits first. Older commits
    /// are verified when they are read.
    std::chrono::milliseconds verifyTime{2'000};
    /// The store is a copy that goes its own way from now on: it takes another identity (ID1).
    bool isNewLine = false;
};

/// Starts the threads that RocksDB shares among all stores of the process, which run as long as the
/// result is kept. Call it before the first store is opened: a store that has to start them cannot
/// report that the system refuses one. Throws ThreadRefused.
[[nodiscard]] std::shared_ptr<void> startStoreThreads();

/// Opens the store in `folder`, or creates one. First writes the next epoch durably.
///
/// Upgrades a store of an older format; an older server cannot read it afterwards. Errors:
/// StorageLocked (another process or store has it open), StorageTooNew, StorageCorrupt
/// (acknowledged content is missing; nothing was changed), StorageFull (too full to open),
/// StorageFailed. The destructor may take as long as a write to the disk.
[[nodiscard]] Result<std::unique_ptr<CommitStore>> createRocksCommitStore(
    const std::filesystem::path& folder, const RocksCommitStoreOptions& options = {});

}  // namespace usdlive::server
