#pragma once

#include <filesystem>
#include <map>
#include <mutex>
#include <optional>
#include <string>

#include "usdlive/common/core/Result.h"
#include "usdlive/server/project/CommitStore.h"

namespace usdlive::server {

/// How the file looks from outside, whose it is and whether it may be written, of a layer named
/// `layer`. Nothing: there is no such file.
[[nodiscard]] std::optional<LayerFile> lookAt(const std::filesystem::path& path, LayerId layer);

/// What the file holds; nothing: there is none. LayerUnreadable: it cannot be read, or is being
/// written all the time.
[[nodiscard]] Result<std::optional<FileStamp>> stampOf(const std::filesystem::path& path);

}  // namespace usdlive::server
