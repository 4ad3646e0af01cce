// Disks of a test's own.
#pragma once

#include <stdlib.h>
#include <sys/mount.h>
#include <sys/statvfs.h>

#include <cstdint>
#include <filesystem>
#include <string>

namespace usdlive::test {

/// A small separate disk; needs root. It is in memory.
class SmallDisk {
public:
    /// `options` are those of a tmpfs: "size=96m".
    explicit SmallDisk(const char* options) {
        std::string name =
            (std::filesystem::temp_directory_path() / "usdlive-disk-XXXXXX").string();
        if (!::mkdtemp(name.data())) return;
        path_ = name;
        isMounted_ = ::mount("tmpfs", path_.c_str(), "tmpfs", 0, options) == 0;
    }
    SmallDisk(const SmallDisk&) = delete;
    SmallDisk& operator=(const SmallDisk&) = delete;
    ~SmallDisk() {
        if (isMounted_) ::umount2(path_.c_str(), MNT_DETACH);
        std::error_code ignored;
        std::filesystem::remove(path_, ignored);
    }
    explicit operator bool() const { return isMounted_; }
    [[nodiscard]] const std::filesystem::path& path() const { return path_; }
    [[nodiscard]] std::uint64_t free() const {
        struct statvfs disk{};
        ::statvfs(path_.c_str(), &disk);
        return disk.f_bavail * disk.f_frsize;
    }
    /// Returns false if more is in use.
    [[nodiscard]] bool resize(std::uint64_t bytes) const {
        const std::string size = "size=" + std::to_string(bytes);
        return ::mount(nullptr, path_.c_str(), nullptr, MS_REMOUNT, size.c_str()) == 0;
    }
    /// Makes it as small as what is in use.
    void fill() const {
        struct statvfs disk{};
        do ::statvfs(path_.c_str(), &disk);
        while (!resize((disk.f_blocks - disk.f_bfree) * disk.f_frsize));
    }
    /// Returns false if a file is open for writing.
    [[nodiscard]] bool makeReadOnly() const {
        return ::mount(nullptr, path_.c_str(), nullptr, MS_REMOUNT | MS_RDONLY, nullptr) == 0;
    }

private:
    std::filesystem::path path_;
    bool isMounted_ = false;
};

}  // namespace usdlive::test
