// The clocks of the client: for intervals, for times that other people read, and for budgets.
#pragma once

#include <chrono>
#include <cstdint>

namespace usdlive {

/// Milliseconds of a clock that never jumps; its zero has no meaning.
inline std::int64_t steadyMs() {
    const auto now = std::chrono::steady_clock::now().time_since_epoch();
    return std::chrono::duration_cast<std::chrono::milliseconds>(now).count();
}

/// Milliseconds since 1970 (UTC).
inline std::int64_t wallClockMs() {
    const auto now = std::chrono::system_clock::now().time_since_epoch();
    return std::chrono::duration_cast<std::chrono::milliseconds>(now).count();
}

/// The time since it was made.
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
