// Receives a stream over DDS: orders segments, joins messages, schedules acknowledgements (DD4).
#include "usdlive/common/dds/SegmentReceiver.h"

#include <algorithm>
#include <utility>

namespace usdlive::dds {

bool SegmentReceiver::received(Segment segment, TimePoint now) {
    if (segment.sequence < next_ || held_.contains(segment.sequence)) {
        ackDue_ = now;  // the sender missed the acknowledgement: send it again
        return true;
    }
    const std::size_t size = segment.bytes.size();
    const bool isNext = segment.sequence == next_;
    if (segment.sequence >= next_ + kWindowSegments || size > kSegmentBytes ||
        (!isNext && heldBytes_ + size > 2 * kWindowBytes))
        return false;
    heldBytes_ += size;
    held_.emplace(segment.sequence, std::move(segment));
    return true;
}

std::optional<StreamMark> SegmentReceiver::next() const {
    if (tooLarge_ || held_.empty() || held_.begin()->first != next_) return std::nullopt;
    return held_.begin()->second.mark;
}

std::optional<SegmentReceiver::Message> SegmentReceiver::take(TimePoint now) {
    while (next()) {
        Segment segment = std::move(held_.extract(held_.begin()).mapped());
        noteTaken(segment.bytes.size(), now);
        if (segment.more || !partial_.empty()) {
            if (partial_.size() + segment.bytes.size() > maxMessageBytes_) {
                tooLarge_ = true;
                return std::nullopt;
            }
            partial_.insert(partial_.end(), segment.bytes.begin(), segment.bytes.end());
            if (segment.more) continue;
            segment.owner = std::make_shared<const Bytes>(std::exchange(partial_, {}));
        }
        return Message{std::move(segment.owner), segment.mark, segment.end};
    }
    return std::nullopt;
}

void SegmentReceiver::noteTaken(std::size_t bytes, TimePoint now) {
    heldBytes_ -= bytes;
    bytesTaken_ += bytes;
    ++unackedSegments_;
    unackedBytes_ += bytes;
    // The first segment is acknowledged at once, because the sender waits to learn whether anybody
    // receives.
    const bool soon = next_ == 1 || unackedSegments_ >= kAckSegments || unackedBytes_ >= kAckBytes;
    const TimePoint due = soon ? now : now + kAckDelay;
    ackDue_ = ackDue_ ? std::min(*ackDue_, due) : due;
    ++next_;
}

void SegmentReceiver::ackSent() {
    ackDue_.reset();
    unackedSegments_ = 0;
    unackedBytes_ = 0;
}

}  // namespace usdlive::dds
