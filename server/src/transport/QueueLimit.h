// Limits the data that waits for a reader.
#pragma once

#include <algorithm>
#include <cstddef>

namespace usdlive::server {

/// Limits the data that waits for one reader; a slower reader is cut off. A few messages may exceed
/// the limit, such as a large commit, or the lists of layers and of their states after a welcome:
/// they are admitted while the queue is within the limit, or has only such messages beyond it, and
/// do not count while they wait. Otherwise every message after them would cut off the reader, which
/// would reconnect and request the same.
class QueueLimit {
public:
    explicit QueueLimit(std::size_t most) : most_(most) {}

    /// Returns false if the reader is too slow for another message of `bytes`. `queued` bytes are
    /// waiting or being sent.
    [[nodiscard]] bool admit(std::size_t queued, std::size_t bytes) {
        if (queued <= most_) large_ = 0;
        if (queued > most_ + large_) return false;
        if (bytes > most_) large_ = std::min(large_ + bytes, kMostLarge);
        return true;
    }

private:
    static constexpr std::size_t kMostLarge = 192 * 1024 * 1024;
    const std::size_t most_;
    std::size_t large_ = 0;  // size of the large messages that wait; 0: none
};

}  // namespace usdlive::server
