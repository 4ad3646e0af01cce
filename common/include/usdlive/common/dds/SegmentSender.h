// Sends a reliable stream in numbered segments over DDS.
#pragma once

#include <chrono>
#include <deque>
#include <optional>
#include <vector>

#include "usdlive/common/dds/Segment.h"

namespace usdlive::dds {

using TimePoint = std::chrono::steady_clock::time_point;

/// The sending end of a stream (DD4). Numbers segments, keeps them until they are acknowledged, and
/// decides which to write now. Segments beyond the window wait. No I/O; one thread.
class SegmentSender {
public:
    /// Used until the first acknowledgement, because the receiver may not be ready yet.
    static constexpr std::chrono::milliseconds kFirstTimeout{20};
    static constexpr std::chrono::milliseconds kTimeout{250};
    static constexpr std::chrono::milliseconds kLongestTimeout{2'000};
    /// The number of segments that are sent again at once. More would only be lost again.
    static constexpr std::size_t kResent = 32;

    /// Queues whole frames, or a mark without frames.
    void push(SharedBytes message, StreamMark mark = {});
    /// Queues the end of the stream. Push nothing afterwards.
    void pushEnd();

    /// Returns the segments to write now: new ones within the window, and those that were not
    /// acknowledged in time.
    [[nodiscard]] std::vector<Segment> take(TimePoint now);
    /// Call when the receiver has acknowledged all segments up to `upTo`. Returns false if that was
    /// known already.
    bool acknowledged(std::uint64_t upTo, TimePoint now);
    /// Drops everything that take() has not returned yet.
    void dropWaiting();

    /// Returns the time when take() has something to send again, or nothing if all is acknowledged.
    [[nodiscard]] std::optional<TimePoint> deadline() const { return resendAt_; }
    [[nodiscard]] bool canTake() const;
    /// Returns the time since when segments are in flight without any acknowledgement.
    [[nodiscard]] std::optional<TimePoint> stalledSince() const;
    [[nodiscard]] std::size_t waitingBytes() const { return waitingBytes_; }
    [[nodiscard]] std::size_t queuedBytes() const { return waitingBytes_ + inFlightBytes_; }
    [[nodiscard]] bool isEmpty() const { return waiting_.empty() && inFlight_.empty(); }

private:
    struct Waiting {
        SharedBytes bytes;
        StreamMark mark;
        bool end = false;
        std::size_t offset = 0;  ///< the bytes before it were sent
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
    /// After a timeout, segments up to this one are sent again as fast as they are acknowledged.
    std::uint64_t recoverTo_ = 0;
    std::chrono::milliseconds timeout_ = kFirstTimeout;
    bool anyAcknowledged_ = false;
    std::optional<TimePoint> resendAt_;
    TimePoint progress_;
};

}  // namespace usdlive::dds
