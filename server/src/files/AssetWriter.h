// Writes a new file into a project's folder, whole or not at all.
#pragma once

#include <sys/stat.h>

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>

#include "project/CommitStore.h"
#include "usdlive/common/core/Bytes.h"
#include "usdlive/common/core/Result.h"

namespace usdlive::server {

/// The place of a file in a project's folder, with all links resolved.
struct AssetPlace {
    std::filesystem::path folder;  ///< relative to the project's; parts of it may be missing
    std::string name;              ///< in this folder
    std::optional<struct stat> present = {};  ///< the file that is there now
};

/// Finds the place of `path`, a valid name (FI7). Follows links inside the project. Errors:
/// InvalidFileName (a link is broken or leads out of the project, to something hidden or to a
/// layer; something else than a file has the name), SaveFailed.
[[nodiscard]] Result<AssetPlace> placeOfAsset(const std::filesystem::path& root,
                                              const std::string& path);

/// The content of a new file.
struct AssetContents {
    std::uint64_t size = 0;
    /// Returns the bytes from `offset` on, at most `count` and at least one.
    std::function<Result<Bytes>(std::uint64_t offset, std::size_t count)> read;
};

/// Writes the file and syncs it to the disk. No step follows a link, so that a folder that is
/// replaced by one meanwhile is an error. `ready` is called directly before the file gets its name,
/// and can prevent that with an error. Returns the trace of the file. Errors: FileExists if
/// `overwrite` is false and a file has the name; StorageFull; SaveFailed with the reason. Nothing
/// is left behind then.
[[nodiscard]] Result<FileTrace> writeAsset(const std::filesystem::path& root,
                                           const AssetPlace& place, const AssetContents& contents,
                                           bool overwrite,
                                           const std::function<Result<void>()>& ready);

}  // namespace usdlive::server
