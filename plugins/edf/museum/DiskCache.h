// Answers of a service, kept on the disk between processes.
#pragma once

#include <cstdint>
#include <filesystem>
#include <mutex>
#include <optional>
#include <string>

namespace usdlive::edf::museum {

/// One answer, with what is needed to ask whether it has changed.
struct CachedAnswer {
    std::string etag, lastModified;
    std::int64_t freshUntil = 0;  ///< seconds since 1970; until then nobody asks
    std::string body;
};

/// A folder with one file for each URL. Several processes may use it at the same time: a file
/// appears complete or not at all, and a file that is damaged, or belongs to another URL, counts as
/// absent. Any thread.
///
/// The folder holds at most about `maxBytes`: after each eighth of it that a process has added, the
/// process removes the answers that were used longest ago. A folder that cannot be used, or a full
/// disk, costs nothing but the caching.
class DiskCache {
public:
    DiskCache(std::filesystem::path folder, std::uintmax_t maxBytes);

    [[nodiscard]] std::optional<CachedAnswer> find(const std::string& url);
    void store(const std::string& url, const CachedAnswer& answer);
    void remove(const std::string& url);

    /// USDLIVE_EDF_CACHE, or else the user's folder for caches.
    [[nodiscard]] static std::filesystem::path defaultFolder();

private:
    [[nodiscard]] std::filesystem::path fileOf(const std::string& url) const;
    void countAdded(std::uintmax_t bytes);
    void evict();

    const std::filesystem::path folder_;
    const std::uintmax_t maxBytes_;
    std::mutex mutex_;      // guards added_
    std::uintmax_t added_;  // by this process since the last look at the folder
};

}  // namespace usdlive::edf::museum
