// A folder that one process uses.
#pragma once

#include <filesystem>
#include <string>

#include "usdlive/common/core/Descriptor.h"

namespace usdlive::client {

/// A folder that one process uses and removes at its end. The process keeps the file
/// `<folder>.lock` next to it locked. If the process was killed, a later one removes the folder
/// (removeDead()).
class ProcessFolder {
public:
    ProcessFolder() = default;
    ProcessFolder(ProcessFolder&& other) noexcept { swap(other); }
    ProcessFolder& operator=(ProcessFolder&& other) noexcept {
        swap(other);
        return *this;
    }
    ~ProcessFolder();

    /// Creates `parent/<prefix><unused name>`, accessible to this user only. The result has an
    /// empty path if it cannot be created.
    [[nodiscard]] static ProcessFolder make(const std::filesystem::path& parent,
                                            const std::string& prefix);
    /// Removes such folders in `parent` whose processes have ended.
    static void removeDead(const std::filesystem::path& parent, const std::string& prefix);

    [[nodiscard]] const std::filesystem::path& path() const { return path_; }
    [[nodiscard]] explicit operator bool() const { return bool(lock_); }

private:
    void swap(ProcessFolder& other) noexcept;

    std::filesystem::path path_;
    Descriptor lock_;
};

/// Returns a name that no other process uses.
[[nodiscard]] std::string unusedName();

}  // namespace usdlive::client
