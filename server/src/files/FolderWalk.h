// Finds the files of a project's folder, also over links inside it, and reports those it skips
// (FI5).
#pragma once

#include <filesystem>
#include <functional>
#include <string>

#include "usdlive/common/core/Result.h"

namespace usdlive::server {

struct FolderVisitor {
    /// Called for a file, with its name below the folder (with the names of links) and its real
    /// path.
    std::function<void(const std::string& name, const std::filesystem::path& real)> file;
    /// Called for a link or folder that is not followed, with the reason.
    std::function<void(const std::string& name, const std::string& reason)> skipped;
    /// Called for the real path of a folder, before its entries are read. May be empty.
    std::function<void(const std::filesystem::path& real)> folder = {};
};

/// Visits every file in `folder` (absolute, without links) and below. Skips hidden files and
/// folders silently. Follows a link if it leads to something in the folder that is not hidden and
/// not a folder above the link. Visits at most kMostOverLinks files over links to folders. Error:
/// LayerUnreadable if the folder itself cannot be listed.
[[nodiscard]] Result<void> walkFolder(const std::filesystem::path& folder,
                                      const FolderVisitor& visitor);
inline constexpr std::size_t kMostOverLinks = 10'000;

/// Returns the reason why a path, absolute and without links, is outside the project in `folder`,
/// or an empty text if it is inside.
[[nodiscard]] std::string whyOutside(const std::filesystem::path& folder,
                                     const std::filesystem::path& real);

}  // namespace usdlive::server
