#pragma once

#include <chrono>
#include <map>
#include <optional>

#include "usdlive/common/dds/Segment.h"
#include "usdlive/common/dds/SegmentSender.h"  // TimePoint

namespace usdlive::dds {

/// The receiving end of a stream (DD4): puts segments in order, joins messages, and says when an
/// acknowledgement is due. What is not taken is not acknowledged, which stops the sender. Without
/// I/O; one thread.
class SegmentReceiver {
public:
    /// An acknowledgement waits so long for something that carries it.
    static constexpr std::chrono::milliseconds kAckDelay{50};
    static constexpr std::uint64_t kAckSegments = 64;
    static constexpr std::size_t kAckBytes = 256 * 1024;

    /// `maxMessageBytes`: of one message that comes in pieces.
    explicit SegmentReceiver(std::size_t maxMessageBytes) : maxMessageBytes_(maxMessageBytes) {}

    /// What came, in any order, any number of times. False: it is no part of the window and was
    /// dropped.
    bool received(Segment segment, TimePoint now);

    struct Message {
        SharedBytes bytes;  ///< whole frames, or nullptr: only a mark
        StreamMark mark;
        bool end = false;
    };
    /// The mark of what is next in order, a whole message or a piece.
    [[nodiscard]] std::optional<StreamMark> next() const;
    /// Takes what next() tells of; nothing while pieces of the message are missing.
    [[nodiscard]] std::optional<Message> take(TimePoint now);
    /// A message was larger than it may be: the stream has ended.
    [[nodiscard]] bool isTooLarge() const { return tooLarge_; }
    /// Of the stream, so far.
    [[nodiscard]] std::uint64_t bytesTaken() const { return bytesTaken_; }

    /// What to acknowledge: all up to this one.
    [[nodiscard]] std::uint64_t taken() const { return next_ - 1; }
    /// When it is due; nothing while it is known at the other end.
    [[nodiscard]] std::optional<TimePoint> ackDue() const { return ackDue_; }
    void ackSent();

private:
    void noteTaken(std::size_t bytes, TimePoint now);

    const std::size_t maxMessageBytes_;
    std::map<std::uint64_t, Segment> held_;
    std::size_t heldBytes_ = 0;
    std::uint64_t next_ = 1;
    std::uint64_t bytesTaken_ = 0;
    Bytes partial_;
    bool tooLarge_ = false;
    std::optional<TimePoint> ackDue_;
    std::uint64_t unackedSegments_ = 0;
    std::size_t unackedBytes_ = 0;
};

}  // namespace usdlive::dds
