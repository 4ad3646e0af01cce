#pragma once

#include <chrono>
#include <deque>
#include <optional>
#include <vector>

#include "usdlive/common/dds/Segment.h"

namespace usdlive::dds {

using TimePoint = std::chrono::steady_clock::time_point;

/// The sending end of a stream (DD4): numbers segments, keeps them until they are acknowledged, and
/// says which to write now. What exceeds the window waits. Without I/O; one thread.
class SegmentSender {
public:
    /// Until something was acknowledged the other end may not be listening yet: soon again.
    static constexpr std::chrono::milliseconds kFirstTimeout{20};
    static constexpr std::chrono::milliseconds kTimeout{250};
    static constexpr std::chrono::milliseconds kLongestTimeout{2'000};
    /// Sent again at a time. More would only be lost where the others were.
    static constexpr std::size_t kResent = 32;

    /// Queues whole frames, or only a mark without any.
    void push(SharedBytes message, StreamMark mark = {});
    /// After all that was pushed; nothing may follow.
    void pushEnd();

    /// What is to be written now: new ones that the window lets through, and those that were not
    /// acknowledged in time.
    [[nodiscard]] std::vector<Segment> take(TimePoint now);
    /// All up to this one have arrived. False: that was known.
    bool acknowledged(std::uint64_t upTo, TimePoint now);
    /// Forgets what has not been taken.
    void dropWaiting();

    /// When take() has something again that it has not now; nothing while all is acknowledged.
    [[nodiscard]] std::optional<TimePoint> deadline() const { return resendAt_; }
    [[nodiscard]] bool canTake() const;
    /// Since when something is on its way and nothing of it has been acknowledged.
    [[nodiscard]] std::optional<TimePoint> stalledSince() const;
    [[nodiscard]] std::size_t waitingBytes() const { return waitingBytes_; }
    [[nodiscard]] std::size_t queuedBytes() const { return waitingBytes_ + inFlightBytes_; }
    [[nodiscard]] bool isEmpty() const { return waiting_.empty() && inFlight_.empty(); }

private:
    struct Waiting {
        SharedBytes bytes;
        StreamMark mark;
        bool end = false;
        std::size_t offset = 0;  ///< what is before it was sent
        [[nodiscard]] std::size_t left() const { return bytes ? bytes->size() - offset : 0; }
    };

    [[nodiscard]] Segment nextSegment();
    [[nodiscard]] Segment piece();
    [[nodiscard]] std::size_t countThatJoin() const;

    std::deque<Waiting> waiting_;
    std::size_t waitingBytes_ = 0;
    std::deque<Segment> inFlight_;
    std::size_t inFlightBytes_ = 0;
    std::uint64_t lastSequence_ = 0;
    /// After a timeout: up to here is sent again as fast as it is acknowledged.
    std::uint64_t recoverTo_ = 0;
    std::chrono::milliseconds timeout_ = kFirstTimeout;
    bool heard_ = false;
    std::optional<TimePoint> resendAt_;
    TimePoint progress_;
};

}  // namespace usdlive::dds
