#pragma once

#include <filesystem>
#include <string>

namespace usdlive::client {

/// A folder that one process uses, and that goes with it. Beside it is a file `<folder>.lock` that
/// the process holds locked: the folder of a process that ended without a word is removed by the
/// next one (removeDead()).
class ProcessFolder {
public:
    ProcessFolder() = default;
    ProcessFolder(ProcessFolder&& other) noexcept { swap(other); }
    ProcessFolder& operator=(ProcessFolder&& other) noexcept {
        swap(other);
        return *this;
    }
    ~ProcessFolder();

    /// Makes `parent/<prefix><something unused>`, for this user alone. Without a path: it cannot be
    /// made.
    [[nodiscard]] static ProcessFolder make(const std::filesystem::path& parent,
                                            const std::string& prefix);
    /// Removes such folders of `parent` whose processes are gone.
    static void removeDead(const std::filesystem::path& parent, const std::string& prefix);

    [[nodiscard]] const std::filesystem::path& path() const { return path_; }
    [[nodiscard]] explicit operator bool() const { return lock_ >= 0; }

private:
    void swap(ProcessFolder& other) noexcept;

    std::filesystem::path path_;
    int lock_ = -1;
};

/// A name that no other process thinks up.
[[nodiscard]] std::string unusedName();

}  // namespace usdlive::client
