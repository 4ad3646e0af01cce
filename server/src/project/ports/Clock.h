// The port to the clocks of the machine.
#pragma once

#include <cstdint>

namespace usdlive::server::ports {

/// Provides the time of day, and a clock for durations.
class Clock {
public:
    virtual ~Clock() = default;
    /// Returns milliseconds since 1970 (UTC). Goes back or far ahead if the machine's clock is set.
    [[nodiscard]] virtual std::int64_t wallClockMs() = 0;
    /// Returns milliseconds since some moment, also while the machine sleeps. Never goes back.
    [[nodiscard]] virtual std::int64_t steadyMs() = 0;
};

}  // namespace usdlive::server::ports
