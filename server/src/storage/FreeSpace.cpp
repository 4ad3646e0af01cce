// Measures the free space of a disk and keeps a reserve file.
#include "storage/FreeSpace.h"

#include <fcntl.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <algorithm>
#include <utility>

#include "storage/Files.h"

namespace usdlive::server {

namespace {

constexpr std::uint64_t kMinFreeBytes = 512 * 1024 * 1024;
constexpr std::uint64_t kMinFreeShare = 50;  // 2 %

}  // namespace

DiskSpace diskSpace(const std::filesystem::path& folder) {
    struct statvfs disk{};
    if (::statvfs(folder.c_str(), &disk) != 0) return {};
    return {std::uint64_t(disk.f_bavail) * disk.f_frsize,
            std::uint64_t(disk.f_blocks) * disk.f_frsize};
}

std::uint64_t minFree(const std::optional<std::uint64_t>& given, const DiskSpace& disk) {
    return given ? *given : std::max(kMinFreeBytes, disk.total / kMinFreeShare);
}

Reserve::Reserve(std::filesystem::path path, std::uint64_t bytes)
    : path_(std::move(path)), bytes_(bytes) {
    std::error_code error;
    there_ = bytes_ == 0 || std::filesystem::file_size(path_, error) == bytes_;
}

void Reserve::adapt(std::uint64_t free, std::uint64_t low, std::uint64_t high) {
    if (bytes_ == 0) return;
    if (there_ && free < low) {
        ::unlink(path_.c_str());
        there_ = false;
    } else if (!there_ && usable(free) >= high) {
        make();
    }
}

void Reserve::make() {
    const auto file = openFile(path_, O_WRONLY | O_CREAT);
    there_ = file && ::posix_fallocate(file->get(), 0, off_t(bytes_)) == 0;
    if (!there_) ::unlink(path_.c_str());
}

}  // namespace usdlive::server
