// Reads and writes files with errors that name the file.
#include "storage/Files.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <system_error>

#include "usdlive/common/core/ByteStream.h"
#include "usdlive/common/core/Hash.h"

namespace usdlive::server {

bool isDiskFull(int error) { return error == ENOSPC || error == EDQUOT || error == EFBIG; }

Error systemError(const char* verb, const std::filesystem::path& path) {
    const std::error_code error(errno, std::system_category());
    const bool full = isDiskFull(error.value());
    return {full ? ErrorCode::StorageFull : ErrorCode::StorageFailed,
            std::string("cannot ") + verb + " " + path.string() + ": " + error.message()};
}

Result<Descriptor> openFile(const std::filesystem::path& path, int flags) {
    // A pipe would block, and a device can be written to.
    Descriptor file(::open(path.c_str(), flags | O_CLOEXEC | O_NONBLOCK, 0666));
    if (!file) return tl::unexpected(systemError("open", path));
    struct stat found{};
    const bool isOther =
        ::fstat(file.get(), &found) == 0 && !S_ISREG(found.st_mode) && !S_ISDIR(found.st_mode);
    if (isOther)
        return fail(ErrorCode::StorageFailed,
                    "cannot open " + path.string() + ": it is not a regular file");
    return file;
}

Result<void> makeFolders(const std::filesystem::path& path) {
    std::error_code error;
    if (path.empty() || std::filesystem::is_directory(path, error)) return {};
    const auto above = path.parent_path();
    if (const auto made = makeFolders(above); !made) return made;
    std::filesystem::create_directory(path, error);
    if (!error) return syncFolder(above.empty() ? "." : above);
    errno = error.value();
    return tl::unexpected(systemError("make the folder", path));
}

Result<void> writeAt(const Descriptor& file, std::uint64_t offset, ByteView bytes,
                     const std::filesystem::path& path) {
    while (!bytes.empty()) {
        const ssize_t written = ::pwrite(file.get(), bytes.data(), bytes.size(), off_t(offset));
        if (written < 0 && errno == EINTR) continue;
        if (written < 0) return tl::unexpected(systemError("write to", path));
        bytes = bytes.subspan(std::size_t(written));
        offset += std::uint64_t(written);
    }
    return {};
}

Result<Bytes> readAt(const Descriptor& file, std::uint64_t offset, std::size_t size,
                     const std::filesystem::path& path) {
    Bytes bytes(size);
    const auto count = readPart(file, offset, bytes);
    if (!count) return tl::unexpected(systemError("read", path));
    bytes.resize(*count);
    return bytes;
}

Result<void> syncFile(const Descriptor& file, const std::filesystem::path& path) {
    if (::fsync(file.get()) != 0) return tl::unexpected(systemError("sync", path));
    return {};
}

Result<void> syncFolder(const std::filesystem::path& path) {
    const auto folder = openFile(path, O_RDONLY | O_DIRECTORY);
    if (!folder) return tl::unexpected(folder.error());
    return syncFile(*folder, path);
}

namespace checkedfile {

Bytes encode(ByteView content) {
    Bytes encoded(content.begin(), content.end());
    appendBytes(encoded, sha256(content).bytes);
    return encoded;
}

std::optional<Bytes> decode(ByteView encoded) {
    constexpr std::size_t kSumBytes = sizeof(Hash);
    if (encoded.size() < kSumBytes) return std::nullopt;
    const ByteView content = encoded.first(encoded.size() - kSumBytes);
    if (!std::ranges::equal(sha256(content).bytes, encoded.last(kSumBytes))) return std::nullopt;
    return Bytes(content.begin(), content.end());
}

std::optional<Bytes> read(const std::filesystem::path& path) {
    std::error_code missing;
    const auto size = std::filesystem::file_size(path, missing);
    const auto file = missing ? Result<Descriptor>() : openFile(path, O_RDONLY);
    const auto encoded = missing || !file ? Result<Bytes>() : readAt(*file, 0, size, path);
    return encoded ? decode(*encoded) : std::nullopt;
}

Result<void> replace(const std::filesystem::path& path, ByteView content) {
    const std::filesystem::path draft = path.string() + kDraft;
    const auto file = openFile(draft, O_WRONLY | O_CREAT | O_TRUNC);
    if (!file) return tl::unexpected(file.error());
    const auto written =
        writeAt(*file, 0, encode(content), draft).and_then([&] { return syncFile(*file, draft); });
    if (!written) {
        ::unlink(draft.c_str());
        return written;
    }
    if (::rename(draft.c_str(), path.c_str()) != 0)
        return tl::unexpected(systemError("rename to", path));
    return syncFolder(path.parent_path());
}

}  // namespace checkedfile
}  // namespace usdlive::server
