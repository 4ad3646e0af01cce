// Reads the attributes and the hash of a layer's file.
#include "files/FileStamps.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>

#include "files/SafeFile.h"
#include "usdlive/common/core/AccountName.h"
#include "usdlive/common/core/Descriptor.h"
#include "usdlive/common/core/Sha256.h"

namespace usdlive::server {

namespace {

constexpr int kAttempts = 3;

std::int64_t nanoseconds(const timespec& time) {
    return std::int64_t(time.tv_sec) * 1'000'000'000 + time.tv_nsec;
}

tl::unexpected<Error> unreadable(const std::filesystem::path& path, const std::string& why) {
    return fail(ErrorCode::LayerUnreadable, path.filename().string() + " cannot be read: " + why);
}

/// Returns nothing if the file was written meanwhile. Reads no more than its size: a device, or a
/// file that grows, may have no end.
Result<std::optional<FileStamp>> attempt(const std::filesystem::path& path, int file) {
    struct stat before{}, after{};
    if (::fstat(file, &before) != 0) return unreadable(path, std::strerror(errno));
    if (!S_ISREG(before.st_mode)) return unreadable(path, "it is not a regular file");
    Sha256 sha;
    static thread_local std::array<std::uint8_t, 1 << 16> part;
    for (std::int64_t left = before.st_size; left >= 0;) {
        const ssize_t count = ::read(file, part.data(), part.size());
        if (count < 0 && errno == EINTR) continue;
        if (count < 0) return unreadable(path, std::strerror(errno));
        if (count == 0) break;
        left -= count;
        sha.add(ByteView(part.data(), std::size_t(count)));
    }
    // The path may name another file by now.
    if (::stat(path.c_str(), &after) != 0 || traceOf(before) != traceOf(after)) return std::nullopt;
    return FileStamp{traceOf(after), sha.finish()};
}

}  // namespace

FileTrace traceOf(const struct stat& found) {
    return {std::uint64_t(found.st_size), found.st_ino, nanoseconds(found.st_mtim),
            nanoseconds(found.st_ctim)};
}

std::optional<LayerFile> lookAt(const std::filesystem::path& path, LayerId layer) {
    struct stat found{};
    if (::lstat(path.c_str(), &found) != 0 || !S_ISREG(found.st_mode)) return std::nullopt;
    static thread_local std::map<uid_t, std::string> names;
    const auto [name, added] = names.try_emplace(found.st_uid);
    if (added) name->second = accountName(found.st_uid).value_or(std::to_string(found.st_uid));
    return LayerFile{std::move(layer), traceOf(found), isWritable(path, found.st_mode),
                     name->second};
}

Result<std::optional<FileStamp>> stampOf(const std::filesystem::path& path) {
    for (int left = kAttempts; left > 0; --left) {
        const Descriptor file(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK));
        if (!file && errno == ENOENT) return std::nullopt;
        if (!file) return unreadable(path, std::strerror(errno));
        auto stamp = attempt(path, file.get());
        if (!stamp || *stamp) return stamp;
    }
    return unreadable(path, "it is being written at this moment");
}

}  // namespace usdlive::server
