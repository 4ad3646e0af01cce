// Stores answers of a service as files, with a bound.
#include "DiskCache.h"

#include <pxr/base/arch/hash.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <charconv>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <system_error>
#include <vector>

namespace usdlive::edf::museum {

namespace fs = std::filesystem;

namespace {

// Changes with the layout of the files: others count as absent.
constexpr std::string_view kMagic = "usdlive-edf-cache 2";
constexpr std::string_view kSuffix = ".answer", kTemporarySuffix = ".part";
constexpr std::uintmax_t kMaxFileBytes = 64u << 20;
// A temporary file of this age was left by a process that ended.
constexpr auto kMaxTemporaryAge = std::chrono::hours(1);

std::string hexOf(std::uint64_t number) {
    std::array<char, 17> text{};
    std::snprintf(text.data(), text.size(), "%016llx", static_cast<unsigned long long>(number));
    return text.data();
}

std::uint64_t hashOf(std::string_view text) { return pxr::ArchHash64(text.data(), text.size()); }

bool isOneLine(const std::string& text) { return text.find('\n') == std::string::npos; }

// Takes a line off the text.
std::string takeLine(std::string_view& text) {
    const auto end = text.find('\n');
    std::string line(text.substr(0, end));
    text.remove_prefix(end == std::string_view::npos ? text.size() : end + 1);
    return line;
}

std::optional<std::string> contentOf(const fs::path& file) {
    std::error_code error;
    const auto size = fs::file_size(file, error);
    if (error || size > kMaxFileBytes) return std::nullopt;
    std::ifstream in(file, std::ios::binary);
    std::string content(size, '\0');
    if (!in.read(content.data(), std::streamsize(size))) return std::nullopt;
    return content;
}

}  // namespace

// Begins with a look at the folder, which earlier processes may have filled.
DiskCache::DiskCache(fs::path folder, std::uintmax_t maxBytes)
    : folder_(std::move(folder)), maxBytes_(maxBytes), added_(maxBytes) {
    std::error_code error;
    if (!folder_.empty()) fs::create_directories(folder_, error);
}

fs::path DiskCache::defaultFolder() {
    if (const char* own = std::getenv("USDLIVE_EDF_CACHE")) return own;
    if (const char* caches = std::getenv("XDG_CACHE_HOME"); caches && *caches)
        return fs::path(caches) / "usdlive" / "edf";
    if (const char* home = std::getenv("HOME"); home && *home)
        return fs::path(home) / ".cache" / "usdlive" / "edf";
    return {};
}

fs::path DiskCache::fileOf(const std::string& url) const {
    return folder_ / (hexOf(hashOf(url)) + std::string(kSuffix));
}

std::optional<CachedAnswer> DiskCache::find(const std::string& url) {
    if (folder_.empty()) return std::nullopt;
    const auto file = fileOf(url);
    const auto content = contentOf(file);
    if (!content) return std::nullopt;
    std::string_view left = *content;
    const auto magic = takeLine(left), hash = takeLine(left);
    if (magic != kMagic || hash != hexOf(hashOf(left))) return std::nullopt;
    const auto ofUrl = takeLine(left), fresh = takeLine(left);
    if (ofUrl != url) return std::nullopt;
    CachedAnswer answer;
    answer.etag = takeLine(left);
    answer.lastModified = takeLine(left);
    answer.body = left;
    const auto number =
        std::from_chars(fresh.data(), fresh.data() + fresh.size(), answer.freshUntil);
    if (number.ec != std::errc()) return std::nullopt;
    std::error_code ignored;  // only the order of removal depends on it
    fs::last_write_time(file, fs::file_time_type::clock::now(), ignored);
    return answer;
}

void DiskCache::store(const std::string& url, const CachedAnswer& answer) {
    if (folder_.empty() || !isOneLine(url) || !isOneLine(answer.etag) ||
        !isOneLine(answer.lastModified))
        return;
    std::string content;
    for (const auto& line :
         {url, std::to_string(answer.freshUntil), answer.etag, answer.lastModified, answer.body})
        content += (content.empty() ? "" : "\n") + line;
    content = std::string(kMagic) + "\n" + hexOf(hashOf(content)) + "\n" + content;
    if (content.size() > std::min(kMaxFileBytes, maxBytes_)) return;

    static std::atomic<unsigned> number = 0;
    const auto temporary = folder_ / (std::to_string(::getpid()) + "-" + std::to_string(++number) +
                                      "-" + hexOf(hashOf(url)) + std::string(kTemporarySuffix));
    std::error_code error;
    {
        std::ofstream out(temporary, std::ios::binary | std::ios::trunc);
        out.write(content.data(), std::streamsize(content.size()));
        out.close();
        if (!out) return void(fs::remove(temporary, error));
    }
    fs::rename(temporary, fileOf(url), error);
    if (error) return void(fs::remove(temporary, error));
    countAdded(content.size());
}

void DiskCache::remove(const std::string& url) {
    std::error_code ignored;
    if (!folder_.empty()) fs::remove(fileOf(url), ignored);
}

void DiskCache::countAdded(std::uintmax_t bytes) {
    const std::lock_guard lock(mutex_);
    added_ += bytes;
    if (added_ < maxBytes_ / 8) return;
    evict();
    added_ = 0;
}

void DiskCache::evict() {
    struct File {
        fs::file_time_type used;
        std::uintmax_t bytes;
        fs::path path;
    };
    std::vector<File> files;
    std::uintmax_t total = 0;
    const auto now = fs::file_time_type::clock::now();
    std::error_code error;
    for (fs::directory_iterator at(folder_, error), end; !error && at != end; at.increment(error)) {
        std::error_code gone;  // another process may have removed it
        const auto bytes = fs::file_size(at->path(), gone);
        if (gone) continue;
        const auto used = fs::last_write_time(at->path(), gone);
        if (gone) continue;
        const auto suffix = at->path().extension();
        if (suffix == kTemporarySuffix && now - used > kMaxTemporaryAge)
            fs::remove(at->path(), gone);
        if (suffix != kSuffix) continue;
        files.push_back({used, bytes, at->path()});
        total += bytes;
    }
    std::ranges::sort(files, {}, &File::used);
    const auto wanted = maxBytes_ - maxBytes_ / 8;
    for (const auto& file : files) {
        if (total <= wanted) break;
        std::error_code gone;
        fs::remove(file.path, gone);
        total -= file.bytes;
    }
}

}  // namespace usdlive::edf::museum
