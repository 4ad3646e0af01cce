#pragma once

#include <sys/types.h>

#include <filesystem>
#include <functional>
#include <string>
#include <string_view>

#include "usdlive/common/core/Result.h"

namespace usdlive::server {

/// May this process write the file, and does anybody have the permission? (Root may write anything,
/// and means a file without write permission to be left alone all the same.)
[[nodiscard]] bool isWritable(const std::filesystem::path& path, mode_t mode);

/// A file that is written beside the one it is to replace, and takes its place in one step or not
/// at all. Removes what was written when it goes without having replaced.
class SafeFile {
public:
    /// Makes an empty file `prefix`...`.extension` in the folder of `target`, with the permissions
    /// that `target` has. Refuses where `target` may not be written to.
    static Result<SafeFile> create(const std::filesystem::path& target, std::string_view prefix,
                                   std::string_view extension);
    SafeFile(SafeFile&& other) noexcept;
    SafeFile& operator=(SafeFile&&) = delete;
    ~SafeFile();

    /// To be written to by its name.
    [[nodiscard]] const std::filesystem::path& temporary() const { return temporary_; }
    /// Brings it to the disk, then into place, unless `objection` has something against that.
    Result<void> replace(const std::function<Result<void>()>& objection);

private:
    SafeFile(std::filesystem::path target, std::filesystem::path temporary);

    std::filesystem::path target_;
    std::filesystem::path temporary_;  // empty: nothing to remove
};

}  // namespace usdlive::server
