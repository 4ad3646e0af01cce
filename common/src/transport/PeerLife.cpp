// Decides whether the peer of a connection is still there (SE7).
#include "usdlive/common/transport/PeerLife.h"

#include <algorithm>

namespace usdlive {

PeerLife::Verdict PeerLife::check(const std::optional<SendProgress>& sent, TimePoint now) {
    if (!ping_) {
        if (now - lastSign_ < longest_ / 2) return Verdict::Alive;
        ping_ = Ping{sent ? sent->acknowledged : 0, {}};
        leaveTimeToAnswer(now);
        return Verdict::SendPing;
    }
    const bool hasArrived = ping_->position && ping_->acknowledged >= *ping_->position;
    if (sent && sent->acknowledged > ping_->acknowledged && !hasArrived) {
        ping_->acknowledged = sent->acknowledged;
        leaveTimeToAnswer(now);
    }
    return now - lastSign_ >= longest_ ? Verdict::Lost : Verdict::Alive;
}

void PeerLife::leaveTimeToAnswer(TimePoint now) {
    lastSign_ = std::max(lastSign_, now - longest_ / 2);
}

}  // namespace usdlive
