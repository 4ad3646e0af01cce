// Reads the attributes and hashes of files.
#pragma once

#include <sys/stat.h>

#include <filesystem>
#include <map>
#include <mutex>
#include <optional>
#include <string>

#include "project/CommitStore.h"
#include "usdlive/common/core/Result.h"

namespace usdlive::server {

[[nodiscard]] FileTrace traceOf(const struct stat& found);

/// Returns the attributes of the file of `layer`: its trace, owner and whether it is writable.
/// Nothing if there is no such file.
[[nodiscard]] std::optional<LayerFile> lookAt(const std::filesystem::path& path, LayerId layer);

/// Returns the trace and the hash of the file, or nothing if there is none. Error: LayerUnreadable
/// if it cannot be read or is being written all the time.
[[nodiscard]] Result<std::optional<FileStamp>> stampOf(const std::filesystem::path& path);

}  // namespace usdlive::server
