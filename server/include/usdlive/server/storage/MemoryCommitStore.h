#pragma once

#include <memory>

#include "usdlive/server/project/CommitStore.h"

namespace usdlive::server {

/// What a CommitStore in memory keeps, as a disk would: it outlives the stores opened on it.
class MemoryDisk;
[[nodiscard]] std::shared_ptr<MemoryDisk> createMemoryDisk();

/// Opens the store that is on the disk, with the next epoch. One at a time.
[[nodiscard]] std::unique_ptr<CommitStore> createMemoryCommitStore(
    std::shared_ptr<MemoryDisk> disk = createMemoryDisk());

}  // namespace usdlive::server
