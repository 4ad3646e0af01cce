// Finds the files of a project's folder, over links inside it too, and says which it passes over
// (FI5).
#pragma once

#include <filesystem>
#include <functional>
#include <string>

#include "usdlive/common/core/Result.h"

namespace usdlive::server {

struct FolderVisitor {
    /// A file: its name below the folder, over links as they are called, and where it really is.
    std::function<void(const std::string& name, const std::filesystem::path& real)> file;
    /// A link or folder that is not followed, and why.
    std::function<void(const std::string& name, const std::string& reason)> skipped;
};

/// Visits every file in `folder` (absolute, without links) and below. Hidden files and folders are
/// passed over without a word. A link is followed where it leads to something in the folder that is
/// not hidden and not a folder above it; at most kMostOverLinks files are visited over links to
/// folders. LayerUnreadable: the folder itself cannot be listed.
[[nodiscard]] Result<void> walkFolder(const std::filesystem::path& folder,
                                      const FolderVisitor& visitor);
inline constexpr std::size_t kMostOverLinks = 10'000;

/// Why a path, absolute and without links, is not of the project in `folder`; nothing: it is.
[[nodiscard]] std::string whyOutside(const std::filesystem::path& folder,
                                     const std::filesystem::path& real);

}  // namespace usdlive::server
