// Answers of a service, kept on the disk between processes.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "usdlive/common/fetch/HashCache.h"

namespace usdlive::edf::museum {

/// One answer, with what is needed to ask whether it has changed.
struct CachedAnswer {
    std::string etag, lastModified;
    std::int64_t freshUntil = 0;  ///< seconds since 1970; until then nobody asks
    std::string body;
};

/// Answers by their URL, in the cache of files that all processes of a user share. A folder that
/// cannot be used, or a full disk, costs nothing but the caching. Any thread.
class AnswerCache {
public:
    AnswerCache() : files_(fetch::HashCache::optionsFromEnvironment()) {}

    [[nodiscard]] std::optional<CachedAnswer> find(const std::string& url);
    void store(const std::string& url, const CachedAnswer& answer);
    void remove(const std::string& url) { files_.forget(url); }

private:
    fetch::HashCache files_;
};

}  // namespace usdlive::edf::museum
