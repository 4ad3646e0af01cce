// Gets many answers of one service at a time.
#pragma once

#include <chrono>
#include <cstddef>
#include <functional>
#include <string>
#include <vector>

#include "Address.h"
#include "AnswerCache.h"
#include "usdlive/common/fetch/Fetched.h"

namespace usdlive::edf::museum {

struct FetchLimits {
    int parallel = 8;  ///< connections at the same time, each with a thread
    std::chrono::milliseconds request{15'000};  ///< for one answer, with the connection
    std::size_t bodyBytes = 16u << 20;          ///< for one answer; longer ones are errors
    std::size_t totalBytes = 256u << 20;        ///< for all answers; the rest is not requested
    int failures =
        3;  ///< so many failed connections or time-outs in a row end all: the service is down
};

/// The body of an answer, or why there is none.
using Body = fetch::Fetched<std::string>;

/// Answers from the cache or from the service. The cache is asked first; an answer that is not
/// fresh any more is revalidated (If-None-Match, If-Modified-Since). If the service cannot be
/// reached, a cached answer is used as it is.
class Fetcher {
public:
    struct Result {
        std::vector<Body> answers;  ///< in the order of the targets
        std::size_t stale = 0;      ///< answers of the cache that could not be revalidated
    };

    /// `cache` may be null; it outlives the fetcher.
    Fetcher(Address address, FetchLimits limits, AnswerCache* cache);

    /// Gets the targets, paths below the address with a leading slash, all of which differ.
    /// Returns early, with errors for the rest, when `isCancelled` (asked every 50 ms, by several
    /// threads) returns true. Any thread; blocks.
    [[nodiscard]] Result get(const std::vector<std::string>& targets,
                             const std::function<bool()>& isCancelled) const;

private:
    const Address address_;
    const FetchLimits limits_;
    AnswerCache* const cache_;
};

}  // namespace usdlive::edf::museum
