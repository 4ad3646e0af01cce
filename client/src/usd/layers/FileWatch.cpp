// Detects changes of layer files.
#include "usd/layers/FileWatch.h"

#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <filesystem>
#include <fstream>

#include "usdlive/common/core/AccountName.h"

namespace usdlive::layers {

namespace {

constexpr std::int64_t kMaxHashedBytes = 16 * 1024 * 1024;

// Respects the permission bits even for users who may ignore them: a file without write permission
// should not be written.
bool isReadOnly(const std::string& path, const struct stat& status) {
    return (status.st_mode & 0222) == 0 || access(path.c_str(), W_OK) != 0;
}

// Cached for each user, because the system reads a file for each query.
const std::string& userName(uid_t user) {
    thread_local std::map<uid_t, std::string> names;
    const auto [entry, isNew] = names.try_emplace(user);
    if (isNew) entry->second = accountName(user).value_or("");
    return entry->second;
}

void describe(const std::string& path, const struct stat& status, FileWatch::Seen& seen) {
    seen.exists = true;
    seen.readOnly = isReadOnly(path, status);
    seen.owner = userName(status.st_uid);
}

}  // namespace

std::optional<std::uint64_t> FileWatch::hashOf(const std::string& path, std::int64_t size) {
    std::error_code ignored;  // a pipe would block
    if (size > kMaxHashedBytes || !std::filesystem::is_regular_file(path, ignored))
        return std::nullopt;
    std::ifstream file(path, std::ios::binary);
    std::uint64_t hash = 14695981039346656037ull;  // FNV-1a
    std::array<char, 65536> block{};
    while (file.read(block.data(), block.size()) || file.gcount() > 0)
        for (std::streamsize i = 0; i < file.gcount(); ++i)
            hash = (hash ^ std::uint8_t(block[std::size_t(i)])) * 1099511628211ull;
    return hash;
}

FileWatch::Seen FileWatch::glance(const std::string& path) {
    Seen seen;
    if (struct stat status{}; !path.empty() && stat(path.c_str(), &status) == 0)
        describe(path, status, seen);
    return seen;
}

FileWatch::Seen FileWatch::look(const std::string& path) {
    Seen seen;
    struct stat status{};
    if (path.empty() || stat(path.c_str(), &status) != 0) return seen;
    describe(path, status, seen);
    const Stamp now{status.st_mtim.tv_sec * 1'000'000'000 + status.st_mtim.tv_nsec, status.st_size};
    const auto [entry, isNew] = files_.try_emplace(path);
    auto& known = entry->second;
    if (isNew) {
        known.stamp = now;
        known.hash = hashOf(path, now.size);
    } else if (now == known.stamp) {
        known.changedTo.reset();
    } else if (known.changedTo != now) {
        const auto hash = hashOf(path, now.size);
        if (hash && hash == known.hash)
            known.stamp = now;
        else
            known.changedTo = now;
    }
    seen.changed = known.changedTo.has_value();
    return seen;
}

// Checks the file again at once, so that any later write of another process is a change.
void FileWatch::accept(const std::string& path) {
    files_.erase(path);
    (void)look(path);
}

}  // namespace usdlive::layers
