// The clocks of the client: for intervals, for displayed times, and for budgets.
#pragma once

#include <chrono>
#include <cstdint>

namespace usdlive {

/// Returns milliseconds of a clock that never jumps and has an arbitrary zero.
inline std::int64_t steadyMs() {
    const auto now = std::chrono::steady_clock::now().time_since_epoch();
    return std::chrono::duration_cast<std::chrono::milliseconds>(now).count();
}

/// Returns milliseconds since 1970 (UTC).
inline std::int64_t wallClockMs() {
    const auto now = std::chrono::system_clock::now().time_since_epoch();
    return std::chrono::duration_cast<std::chrono::milliseconds>(now).count();
}

/// Measures the time since its construction.
class Stopwatch {
public:
    [[nodiscard]] double ms() const {
        return std::chrono::duration<double, std::milli>(Clock::now() - start_).count();
    }

private:
    using Clock = std::chrono::steady_clock;
    Clock::time_point start_ = Clock::now();
};

}  // namespace usdlive
