// Gets many answers of one service at a time over HTTP or HTTPS.
#pragma once

#include <chrono>
#include <cstddef>
#include <functional>
#include <string>
#include <tl/expected.hpp>
#include <vector>

#include "Address.h"
#include "DiskCache.h"

namespace usdlive::edf::museum {

struct FetchLimits {
    int parallel = 8;  ///< connections at the same time
    /// for one connection, with the look-up of the host and the handshake of TLS
    std::chrono::milliseconds connect{5'000};
    std::chrono::milliseconds request{
        15'000};                          ///< for one answer, from the request to its last byte
    std::size_t bodyBytes = 16u << 20;    ///< for one answer; longer ones are errors
    std::size_t totalBytes = 256u << 20;  ///< for all answers; the rest is not requested
    int failures =
        3;  ///< so many failed connections or time-outs in a row end all: the service is down
};

/// The body of an answer, or why there is none.
using Fetched = tl::expected<std::string, std::string>;

/// Answers from the cache or from the service. The cache is asked first; an answer that is not
/// fresh any more is revalidated (If-None-Match, If-Modified-Since). If the service cannot be
/// reached, a cached answer is used as it is.
class Fetcher {
public:
    struct Result {
        std::vector<Fetched> answers;  ///< in the order of the targets
        std::size_t stale = 0;         ///< answers of the cache that could not be revalidated
    };

    /// `cache` may be null; it outlives the fetcher. With HTTPS, the service needs a certificate
    /// for its host that the system trusts, or that SSL_CERT_FILE or SSL_CERT_DIR names.
    Fetcher(Address address, FetchLimits limits, DiskCache* cache);

    /// Gets the targets, paths below the address with a leading slash, all of which differ. Sends
    /// one request for each, and a second only if a kept connection was closed before the answer
    /// began. Returns early, with errors for the rest, when `isCancelled` (asked every 50 ms)
    /// returns true. Any thread; blocks.
    [[nodiscard]] Result get(const std::vector<std::string>& targets,
                             const std::function<bool()>& isCancelled) const;

private:
    const Address address_;
    const FetchLimits limits_;
    DiskCache* const cache_;
};

}  // namespace usdlive::edf::museum
