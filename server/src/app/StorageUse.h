// Measures the disk space of a project.
#pragma once

#include <filesystem>

#include "project/CommitStore.h"

namespace usdlive::server {

/// Returns the disk space of a store and its big values, by kind and by layer. May be called from
/// any thread. Slow: reads the whole history once. A layer's part of the log is its share of the
/// bytes of all edits. Error: ShuttingDown if `keepRunning` returned false.
[[nodiscard]] Result<Storage> measureStorage(const CommitStore& store,
                                             const std::filesystem::path& blobs,
                                             const CommitStore::KeepRunning& keepRunning);

}  // namespace usdlive::server
