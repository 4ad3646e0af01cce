#pragma once

#include <filesystem>

#include "usdlive/server/project/CommitStore.h"

namespace usdlive::server {

/// What a store and the folder of its big values take, by kind and by layer. Any thread; reads the
/// whole history once, which takes long. A layer's part of the log is its share of the commits'
/// edits, in bytes as they are on the disk. ShuttingDown: `goesOn` said false.
[[nodiscard]] Result<Storage> measureStorage(const CommitStore& store,
                                             const std::filesystem::path& blobs,
                                             const CommitStore::GoesOn& goesOn);

}  // namespace usdlive::server
