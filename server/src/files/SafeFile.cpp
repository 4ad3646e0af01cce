// Replaces a file atomically.
#include "files/SafeFile.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <utility>

#include "usdlive/common/core/Descriptor.h"

namespace usdlive::server {

namespace fs = std::filesystem;

namespace {

constexpr mode_t kWriteBits = 0222;

tl::unexpected<Error> failedTo(const char* what) {
    return fail(ErrorCode::SaveFailed, std::string(what) + ": " + std::strerror(errno));
}

Result<void> syncPath(const fs::path& path, int flags) {
    const Descriptor file(::open(path.c_str(), flags | O_CLOEXEC));
    if (!file) return failedTo("cannot be opened for syncing");
    if (::fsync(file.get()) != 0) return failedTo("cannot be synced to the disk");
    return {};
}

}  // namespace

mode_t permissionsLike(const struct stat* present) {
    constexpr mode_t kPermissionBits = 07777, kNewFile = 0644;
    return present ? present->st_mode & kPermissionBits : kNewFile;
}

void startWritingBack(const fs::path& path) {
    const Descriptor file(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
    if (file) ::sync_file_range(file.get(), 0, 0, SYNC_FILE_RANGE_WRITE);
}

bool isWritable(const fs::path& path, mode_t mode) {
    return (mode & kWriteBits) != 0 && ::access(path.c_str(), W_OK) == 0;
}

SafeFile::SafeFile(fs::path target, fs::path temporary)
    : target_(std::move(target)), temporary_(std::move(temporary)) {}

SafeFile::SafeFile(SafeFile&& other) noexcept
    : target_(std::move(other.target_)), temporary_(std::exchange(other.temporary_, {})) {}

SafeFile::~SafeFile() {
    std::error_code ignored;
    if (!temporary_.empty()) fs::remove(temporary_, ignored);
}

Result<SafeFile> SafeFile::create(const fs::path& target, std::string_view prefix,
                                  std::string_view extension) {
    struct stat present{};
    const bool exists = ::stat(target.c_str(), &present) == 0;
    if (exists && !S_ISREG(present.st_mode))
        return fail(ErrorCode::SaveFailed, "something else than a file has its name: remove it");
    if (exists && !isWritable(target, present.st_mode)) {
        errno = EACCES;
        return failedTo("is not writable");
    }
    const std::string suffix = "." + std::string(extension);
    std::string name = target.parent_path() / (std::string(prefix) + "XXXXXX" + suffix);
    const Descriptor file(::mkostemps(name.data(), int(suffix.size()), O_CLOEXEC));
    if (!file) return failedTo("its folder is not writable");
    SafeFile safe(target, name);
    const mode_t mode = permissionsLike(exists ? &present : nullptr);
    if (::fchmod(file.get(), mode) != 0) return failedTo("cannot get its permissions");
    return safe;
}

Result<void> SafeFile::replace(const std::function<Result<void>()>& objection) {
    if (auto synced = syncPath(temporary_, O_RDONLY); !synced) return synced;
    if (auto objected = objection(); !objected) return objected;
    if (std::rename(temporary_.c_str(), target_.c_str()) != 0)
        return failedTo("cannot replace the old file");
    temporary_.clear();
    return syncPath(target_.parent_path(), O_RDONLY | O_DIRECTORY);
}

}  // namespace usdlive::server
