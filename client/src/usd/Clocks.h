// The two clocks of the client: one for intervals, one for times that other people read.
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

}  // namespace usdlive
