#pragma once

#include <algorithm>
#include <cstddef>

namespace usdlive::server {

/// How much may wait for one reader before it is cut as too slow. One message may be larger than
/// the limit: it is let in while the queue is within the limit, and does not count as long as it
/// waits. Otherwise whatever follows a large commit would cut its reader, who would come again for
/// the same commit.
class QueueLimit {
public:
    explicit QueueLimit(std::size_t most) : most_(most) {}

    /// Returns false if the reader is too slow for another message of `bytes`, with `queued` bytes
    /// waiting or on their way.
    [[nodiscard]] bool admit(std::size_t queued, std::size_t bytes) {
        if (queued <= most_) large_ = 0;
        if (queued > most_ + large_) return false;
        if (bytes > most_) large_ = std::max(large_, bytes);
        return true;
    }

private:
    const std::size_t most_;
    std::size_t large_ = 0;  // the size of the large message that waits; 0: none does
};

}  // namespace usdlive::server
