// Copies folders, and shares files that never change.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <system_error>

#include "usdlive/common/core/Result.h"

namespace usdlive::server {

/// Counts what was copied.
struct Copied {
    std::uint64_t files = 0, bytes = 0;
};

/// Returns the error StorageFull or StorageFailed.
[[nodiscard]] tl::unexpected<Error> cannotCopy(const std::filesystem::path& path,
                                               const std::error_code& error);

/// Copies a folder with everything in it into a new one. Links stay links, and files that are
/// removed meanwhile are left out. `shares`: the files never change, so that both folders may have
/// the same ones (hard links) if they are on one file system. `isLeftOut` sees the names in the
/// folder itself. Blocks; any thread. After an error a part is left.
[[nodiscard]] Result<void> copyFolder(
    const std::filesystem::path& from, const std::filesystem::path& to, bool shares, Copied& copied,
    const std::function<bool(const std::filesystem::path&)>& isLeftOut = {});

}  // namespace usdlive::server
