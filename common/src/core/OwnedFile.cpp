// Replaces and locks files.
#include "usdlive/common/core/OwnedFile.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <system_error>

namespace usdlive {

namespace fs = std::filesystem;

namespace {

tl::unexpected<Error> ownedFileError(const char* verb, const fs::path& path) {
    return fail(ErrorCode::StorageFailed, "cannot " + std::string(verb) + " " + path.string() +
                                              ": " + std::generic_category().message(errno));
}

Result<Descriptor> openLock(const fs::path& path) {
    Descriptor file(::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, kOwnerOnly));
    if (!file) return ownedFileError("open", path);
    return file;
}

bool writeAll(const Descriptor& file, std::string_view content) {
    while (!content.empty()) {
        const ssize_t count = ::write(file.get(), content.data(), content.size());
        if (count < 0 && errno == EINTR) continue;
        if (count < 0) return false;
        content.remove_prefix(std::size_t(count));
    }
    return true;
}

}  // namespace

Result<void> replaceFile(const fs::path& path, std::string_view content, mode_t mode) {
    std::string draft = path.string() + ".XXXXXX";
    const Descriptor file(::mkostemp(draft.data(), O_CLOEXEC));  // only its owner can read it
    if (!file) return ownedFileError("write", path);
    if (!writeAll(file, content) || ::fchmod(file.get(), mode) != 0 || ::fsync(file.get()) != 0 ||
        std::rename(draft.c_str(), path.c_str()) != 0) {
        auto failed = ownedFileError("write", path);
        ::unlink(draft.c_str());
        return failed;
    }
    const Descriptor folder(::open(path.parent_path().c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
    if (folder) ::fsync(folder.get());
    return {};
}

Result<Descriptor> lockFile(const fs::path& path) {
    auto file = openLock(path);
    while (file && ::flock(file->get(), LOCK_EX) != 0)
        if (errno != EINTR) return ownedFileError("lock", path);
    return file;
}

Result<std::optional<Descriptor>> tryLockFile(const fs::path& path) {
    auto file = openLock(path);
    if (!file) return tl::unexpected(file.error());
    while (::flock(file->get(), LOCK_EX | LOCK_NB) != 0) {
        if (errno == EWOULDBLOCK) return std::nullopt;
        if (errno != EINTR) return ownedFileError("lock", path);
    }
    return std::move(*file);
}

}  // namespace usdlive
