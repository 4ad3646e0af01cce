// The time of day of a project.
#pragma once

#include <cstdint>
#include <optional>

#include "project/Wiring.h"
#include "project/ports/Clock.h"

namespace usdlive::server {

/// The time of day of a project: the machine's clock, without its short jumps (CH6). After a jump,
/// it goes on as before until the clock has been right or wrong in the same way for an hour. So a
/// clock that is wrong for some minutes neither gives commits a wrong time nor makes them look old.
class TimeOfDay {
public:
    explicit TimeOfDay(ports::Clock& clock) : clock_(clock) {}

    /// Returns milliseconds since 1970 (UTC).
    [[nodiscard]] std::int64_t nowMs();
    /// Returns the earlier one of nowMs() and the machine's clock, for what removes old data.
    [[nodiscard]] std::int64_t earliestMs();

private:
    struct Jump {
        std::int64_t offsetMs = 0;
        std::int64_t sinceMs = 0;  ///< steady time
    };
    Wire<ports::Clock> clock_;
    std::optional<std::int64_t> offsetMs_;  ///< from the steady time to the time of day
    std::optional<Jump> jump_;              ///< a new offset that does not count yet
};

}  // namespace usdlive::server
