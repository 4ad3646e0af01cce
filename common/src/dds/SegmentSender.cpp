// Sends a stream over DDS: cuts segments, keeps the window, resends (DD4).
#include "usdlive/common/dds/SegmentSender.h"

#include <algorithm>

namespace usdlive::dds {

namespace {

// Small messages are joined up to this size, because a sample costs about as much as copying this.
constexpr std::size_t kJoinedBytes = 64 * 1024;

}  // namespace

void SegmentSender::push(SharedBytes message, StreamMark mark) {
    if (message) waitingBytes_ += message->size();
    waiting_.push_back({std::move(message), mark});
}

void SegmentSender::pushEnd() { waiting_.push_back({nullptr, {}, true}); }

bool SegmentSender::canTake() const {
    return !waiting_.empty() && inFlight_.size() < kWindowSegments &&
           (inFlight_.empty() ||
            inFlightBytes_ + std::min(waiting_.front().left(), kSegmentBytes) <= kWindowBytes);
}

std::vector<Segment> SegmentSender::take(TimePoint now) {
    std::vector<Segment> due;
    if (resendAt_ && now >= *resendAt_) {
        due.assign(inFlight_.begin(),
                   inFlight_.begin() + std::ptrdiff_t(std::min(kResent, inFlight_.size())));
        if (inFlight_.front().sequence > recoverTo_) recoverTo_ = lastSequence_;
        timeout_ = std::min(timeout_ * 2, kLongestTimeout);
        resendAt_ = now + timeout_;
    }
    while (canTake()) {
        Segment segment = nextSegment();
        segment.sequence = ++lastSequence_;
        waitingBytes_ -= segment.bytes.size();
        inFlightBytes_ += segment.bytes.size();
        if (inFlight_.empty()) {
            progress_ = now;
            resendAt_ = now + timeout_;
        }
        inFlight_.push_back(segment);
        due.push_back(std::move(segment));
    }
    return due;
}

bool SegmentSender::acknowledged(std::uint64_t upTo, TimePoint now) {
    if (inFlight_.empty() || upTo < inFlight_.front().sequence || upTo > lastSequence_)
        return false;
    while (!inFlight_.empty() && inFlight_.front().sequence <= upTo) {
        inFlightBytes_ -= inFlight_.front().bytes.size();
        inFlight_.pop_front();
    }
    anyAcknowledged_ = true;
    timeout_ = kTimeout;
    progress_ = now;
    if (inFlight_.empty())
        resendAt_.reset();
    else
        resendAt_ = upTo < recoverTo_ ? now : now + timeout_;
    return true;
}

void SegmentSender::dropWaiting() {
    // A message that was partly sent must be completed.
    const bool begun = !waiting_.empty() && waiting_.front().offset > 0;
    waiting_.erase(waiting_.begin() + (begun ? 1 : 0), waiting_.end());
    waitingBytes_ = begun ? waiting_.front().left() : 0;
}

std::optional<TimePoint> SegmentSender::stalledSince() const {
    return inFlight_.empty() ? std::nullopt : std::optional(progress_);
}

Segment SegmentSender::nextSegment() {
    if (waiting_.front().left() > kSegmentBytes) return piece();
    const std::size_t count = countThatJoin();
    Segment segment;
    segment.mark = waiting_.front().mark;
    if (count == 1) {
        const Waiting& only = waiting_.front();
        segment.owner = only.bytes;
        if (only.bytes) segment.bytes = ByteView(*only.bytes).subspan(only.offset);
    } else {
        auto joined = std::make_shared<Bytes>();
        for (std::size_t index = 0; index < count; ++index)
            if (const auto& bytes = waiting_[index].bytes)
                joined->insert(joined->end(), bytes->begin(), bytes->end());
        segment.bytes = *joined;
        segment.owner = std::move(joined);
    }
    segment.mark.liveFrom = waiting_[count - 1].mark.liveFrom;
    segment.end = waiting_[count - 1].end;
    waiting_.erase(waiting_.begin(), waiting_.begin() + std::ptrdiff_t(count));
    return segment;
}

Segment SegmentSender::piece() {
    Waiting& large = waiting_.front();
    Segment segment;
    segment.mark.afterCommit = large.mark.afterCommit;
    segment.more = true;
    segment.owner = large.bytes;
    segment.bytes = ByteView(*large.bytes).subspan(large.offset, kSegmentBytes);
    large.offset += kSegmentBytes;
    return segment;
}

/// Returns the number of waiting messages that fit into one segment. They belong to the same
/// commit, up to one after which commits come again. A mark that starts states or presences gets a
/// segment of its own.
std::size_t SegmentSender::countThatJoin() const {
    std::size_t count = 1, bytes = waiting_.front().left();
    while (count < waiting_.size()) {
        const Waiting& last = waiting_[count - 1];
        const Waiting& next = waiting_[count];
        if (last.mark.liveFrom != 0 || last.end || last.offset > 0) break;
        if (next.mark.hold || next.mark.afterCommit != last.mark.afterCommit) break;
        if (last.mark.startsUpdates() || next.mark.startsUpdates()) break;
        bytes += next.left();
        if (bytes > kJoinedBytes) break;
        ++count;
    }
    return count;
}

}  // namespace usdlive::dds
