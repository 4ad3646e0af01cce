// The port to the clock.
#pragma once

#include <cstdint>

namespace usdlive::server::ports {

class Clock {
public:
    virtual ~Clock() = default;
    /// Milliseconds since 1970; may jump when the machine's clock is set.
    [[nodiscard]] virtual std::int64_t wallClockMs() = 0;
};

}  // namespace usdlive::server::ports
