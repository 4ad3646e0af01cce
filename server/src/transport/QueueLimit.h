// Limits the data that waits for a reader.
#pragma once

#include <algorithm>
#include <cstddef>

namespace usdlive::server {

/// Limits the data that waits for one reader; a slower reader is cut off. One message may exceed
/// the limit: it is admitted while the queue is within the limit and does not count while it waits.
/// Otherwise every message after a large commit would cut off the reader, which would reconnect and
/// request the same commit.
class QueueLimit {
public:
    explicit QueueLimit(std::size_t most) : most_(most) {}

    /// Returns false if the reader is too slow for another message of `bytes`. `queued` bytes are
    /// waiting or being sent.
    [[nodiscard]] bool admit(std::size_t queued, std::size_t bytes) {
        if (queued <= most_) large_ = 0;
        if (queued > most_ + large_) return false;
        if (bytes > most_) large_ = std::max(large_, bytes);
        return true;
    }

private:
    const std::size_t most_;
    std::size_t large_ = 0;  // size of the large message that waits; 0: none
};

}  // namespace usdlive::server
