// Computes the pauses between questions to an issuer.
#include "auth/KeySchedule.h"

#include <algorithm>
#include <utility>

namespace usdlive::server {

bool KeySchedule::mayLook(Time now) const { return !lookedAt_ || now - *lookedAt_ >= kLookPause; }

KeySchedule::Next KeySchedule::read(Time now) {
    readAt_ = now;
    retry_ = kFirstRetry;
    return {kRefresh, std::exchange(hasFailed_, false) != false, false};
}

KeySchedule::Next KeySchedule::failed(Time now) {
    Next next{retry_, std::exchange(hasFailed_, true) != true, false};
    retry_ = std::min<Duration>(2 * retry_, kLongestRetry);
    if (readAt_ && now - *readAt_ >= kKeysLast) {
        next.endsKeys = true;
        readAt_.reset();
    }
    return next;
}

}  // namespace usdlive::server
