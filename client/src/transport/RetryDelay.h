// The delay before the next attempt to connect.
#pragma once

#include <algorithm>
#include <chrono>
#include <random>

namespace usdlive::client {

/// Computes the delay before the next attempt to connect. It increases, with full jitter, so that
/// the clients of a restarted server do not all connect at once.
class RetryDelay {
public:
    static constexpr std::chrono::milliseconds kFirst{100};
    static constexpr std::chrono::milliseconds kLongest{5'000};
    /// After a connection that lasted this long, the delay is short again.
    static constexpr std::chrono::seconds kStableAfter{5};

    /// `lasted` is the duration of the last attempt, including its connection.
    [[nodiscard]] std::chrono::milliseconds next(std::chrono::steady_clock::duration lasted) {
        failures_ = lasted > kStableAfter ? 0 : failures_ + 1;
        const auto doubled = kFirst * (1 << std::min(std::max(failures_ - 1, 0), 10));
        const auto longest = std::min<std::chrono::milliseconds>(doubled, kLongest);
        return std::chrono::milliseconds(
            std::uniform_int_distribution<long long>(0, longest.count())(random_));
    }

private:
    int failures_ = 0;
    std::mt19937 random_{std::random_device{}()};
};

}  // namespace usdlive::client
