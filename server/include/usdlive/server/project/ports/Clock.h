// The port to the time of day.
#pragma once

#include <cstdint>

namespace usdlive::server::ports {

/// Provides the time of day.
class Clock {
public:
    virtual ~Clock() = default;
    /// Returns milliseconds since 1970 (UTC). May go back if the machine's clock is set.
    [[nodiscard]] virtual std::int64_t wallClockMs() = 0;
};

}  // namespace usdlive::server::ports
