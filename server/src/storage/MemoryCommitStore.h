// Stores a project's history in memory, for tests.
#pragma once

#include <memory>

#include "project/CommitStore.h"

namespace usdlive::server {

/// The content of a CommitStore in memory. Like a disk, it outlives the stores that are opened on
/// it.
class MemoryDisk;
/// `identity` is that of the store on it, for a copy of another disk.
[[nodiscard]] std::shared_ptr<MemoryDisk> createMemoryDisk(StoreId identity = {randomIdDigits()});

/// Opens the store on `disk` with the next epoch. Only one store may be open on a disk.
[[nodiscard]] std::unique_ptr<CommitStore> createMemoryCommitStore(
    std::shared_ptr<MemoryDisk> disk = createMemoryDisk());

}  // namespace usdlive::server
