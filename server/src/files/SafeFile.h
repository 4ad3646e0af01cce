// Replaces a file atomically.
#pragma once

#include <sys/stat.h>
#include <sys/types.h>

#include <filesystem>
#include <functional>
#include <string>
#include <string_view>

#include "usdlive/common/core/Result.h"

namespace usdlive::server {

/// Temporary files have names that begin like this. No name of a layer or of another file of the
/// project does (LN1, FI7). createLayerFiles() removes those that an earlier process has left.
inline constexpr std::string_view kTemporaryPrefix = ".usdlive-save-";

/// Returns true if this process may write the file and its permissions allow it to anybody. (Root
/// may write any file, but respects a file without write permission.)
[[nodiscard]] bool isWritable(const std::filesystem::path& path, mode_t mode);
/// Returns the permissions of a file that replaces `present`, or of a new file if that is nullptr.
[[nodiscard]] mode_t permissionsLike(const struct stat* present);

/// Starts to write the file's content to the disk and returns at once, so that a later sync has
/// less to wait for. Failures show in that sync.
void startWritingBack(const std::filesystem::path& file);

/// A temporary file beside a target file. It replaces the target in one step or not at all. The
/// destructor removes it if it has not replaced the target.
class SafeFile {
public:
    /// Creates an empty file `prefix`...`.extension` in the folder of `target`, with the
    /// permissions of `target`. Fails if `target` is not writable.
    static Result<SafeFile> create(const std::filesystem::path& target, std::string_view prefix,
                                   std::string_view extension);
    SafeFile(SafeFile&& other) noexcept;
    SafeFile& operator=(SafeFile&&) = delete;
    ~SafeFile();

    /// The path for writing the content.
    [[nodiscard]] const std::filesystem::path& temporary() const { return temporary_; }
    /// Syncs the file to the disk and replaces the target, unless `objection` returns an error.
    Result<void> replace(const std::function<Result<void>()>& objection);

private:
    SafeFile(std::filesystem::path target, std::filesystem::path temporary);

    std::filesystem::path target_;
    std::filesystem::path temporary_;  // empty: there is nothing to remove
};

}  // namespace usdlive::server
