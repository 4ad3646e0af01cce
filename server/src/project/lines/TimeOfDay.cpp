// Follows the machine's clock, except when it jumps for a short time.
#include "project/lines/TimeOfDay.h"

#include <algorithm>
#include <cstdlib>

namespace usdlive::server {

namespace {

constexpr std::int64_t kJumpMs = 60'000;        // smaller changes are followed at once
constexpr std::int64_t kLastingMs = 3'600'000;  // a jump counts after this time

}  // namespace

std::int64_t TimeOfDay::nowMs() {
    const std::int64_t steady = clock_->steadyMs(), offset = clock_->wallClockMs() - steady;
    const auto isNear = [&](std::int64_t other) { return std::abs(offset - other) <= kJumpMs; };
    const bool lasted = jump_ && isNear(jump_->offsetMs) && steady - jump_->sinceMs >= kLastingMs;
    if (!offsetMs_ || isNear(*offsetMs_) || lasted) {
        offsetMs_ = offset;
        jump_.reset();
    } else if (!jump_ || !isNear(jump_->offsetMs)) {
        jump_ = Jump{offset, steady};
    }
    return steady + *offsetMs_;
}

std::int64_t TimeOfDay::earliestMs() { return std::min(nowMs(), clock_->wallClockMs()); }

}  // namespace usdlive::server
