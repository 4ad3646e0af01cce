// Files that several processes of one user change: replacing a whole file, and taking turns.
#pragma once

#include <sys/types.h>

#include <filesystem>
#include <optional>
#include <string_view>

#include "usdlive/common/core/Descriptor.h"
#include "usdlive/common/core/Result.h"

namespace usdlive {

/// Permissions of a file that nobody but its owner may read.
inline constexpr mode_t kOwnerOnly = 0600;

/// Replaces the content of a file. A reader finds the old or the new content, also after a crash of
/// the machine. Any thread; blocks for the disk. Error: StorageFailed names the file and the cause.
[[nodiscard]] Result<void> replaceFile(const std::filesystem::path& path, std::string_view content,
                                       mode_t mode);

/// Creates the file if it is missing, and waits until no other process and no other thread has it
/// locked. Closing the descriptor unlocks it. Error: StorageFailed names the file and the cause.
[[nodiscard]] Result<Descriptor> lockFile(const std::filesystem::path& path);
/// The same without waiting. Returns nothing if another one has it locked.
[[nodiscard]] Result<std::optional<Descriptor>> tryLockFile(const std::filesystem::path& path);

}  // namespace usdlive
