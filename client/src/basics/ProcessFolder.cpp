// Creates and removes folders that one process uses.
#include "basics/ProcessFolder.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <random>
#include <system_error>
#include <utility>
#include <vector>

namespace usdlive::client {

namespace {

namespace fs = std::filesystem;

constexpr const char* kLock = ".lock";
constexpr int kAttempts = 3;

// Returns the locked file, or none if another process has locked it or it no longer exists.
Descriptor lockFile(const fs::path& path, int flags) {
    Descriptor file(::open(path.c_str(), O_RDWR | O_CLOEXEC | O_NOFOLLOW | flags, 0600));
    if (!file) return file;
    struct stat opened{}, named{};
    // A process that removes the file has it locked, so it may have disappeared before flock().
    if (::flock(file.get(), LOCK_EX | LOCK_NB) == 0 && ::fstat(file.get(), &opened) == 0 &&
        ::stat(path.c_str(), &named) == 0 && opened.st_ino == named.st_ino)
        return file;
    return Descriptor();
}

// Keeps the lock until the folder was removed.
void remove(const fs::path& folder, const Descriptor& /*lock*/) {
    std::error_code ignored;
    fs::remove_all(folder, ignored);
    fs::remove(folder.string() + kLock, ignored);
}

}  // namespace

std::string unusedName() {
    std::random_device random;
    return std::to_string(::getpid()) + "-" + std::to_string(random());
}

ProcessFolder::~ProcessFolder() {
    if (lock_) remove(path_, lock_);
}

void ProcessFolder::swap(ProcessFolder& other) noexcept {
    path_.swap(other.path_);
    std::swap(lock_, other.lock_);
}

ProcessFolder ProcessFolder::make(const fs::path& parent, const std::string& prefix) {
    ProcessFolder made;
    for (int attempt = 0; attempt < kAttempts; ++attempt) {
        const fs::path path = parent / (prefix + unusedName());
        Descriptor lock = lockFile(path.string() + kLock, O_CREAT | O_EXCL);
        if (!lock) continue;
        if (::mkdir(path.c_str(), 0700) != 0) {
            remove(path, lock);
            break;
        }
        made.path_ = path;
        made.lock_ = std::move(lock);
        break;
    }
    return made;
}

void ProcessFolder::removeDead(const fs::path& parent, const std::string& prefix) {
    std::error_code ignored;
    std::vector<fs::path> locks;
    for (const auto& entry : fs::directory_iterator(parent, ignored))
        if (entry.path().filename().string().starts_with(prefix) &&
            entry.path().extension() == kLock)
            locks.push_back(entry.path());
    for (const fs::path& path : locks)
        if (const Descriptor lock = lockFile(path, 0))
            remove(fs::path(path).replace_extension(), lock);
}

}  // namespace usdlive::client
