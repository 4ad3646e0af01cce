// Receives a reliable stream in numbered segments over DDS.
#pragma once

#include <chrono>
#include <map>
#include <optional>

#include "usdlive/common/dds/Segment.h"
#include "usdlive/common/dds/SegmentSender.h"  // TimePoint

namespace usdlive::dds {

/// The receiving end of a stream (DD4). Puts segments in order, joins messages and reports when an
/// acknowledgement is due. Segments that are not taken are not acknowledged, which stops the
/// sender. No I/O; one thread.
class SegmentReceiver {
public:
    /// An acknowledgement waits this long for a message that can carry it.
    static constexpr std::chrono::milliseconds kAckDelay{50};
    static constexpr std::uint64_t kAckSegments = 64;
    static constexpr std::size_t kAckBytes = 256 * 1024;

    /// `maxMessageBytes` limits a message that arrives in pieces.
    explicit SegmentReceiver(std::size_t maxMessageBytes) : maxMessageBytes_(maxMessageBytes) {}

    /// Call for each received segment, in any order and any number of times. Returns false if the
    /// segment is outside the window and was dropped.
    bool received(Segment segment, TimePoint now);

    struct Message {
        SharedBytes bytes;  ///< whole frames, or nullptr: only a mark
        StreamMark mark;
        bool end = false;
    };
    /// Returns the mark of the next whole message or piece in order.
    [[nodiscard]] std::optional<StreamMark> next() const;
    /// Takes the part that next() describes. Returns nothing while pieces of the message are
    /// missing.
    [[nodiscard]] std::optional<Message> take(TimePoint now);
    /// Returns true after a message exceeded the limit. The stream has ended then.
    [[nodiscard]] bool isTooLarge() const { return tooLarge_; }
    /// Returns the number of bytes taken from the stream so far.
    [[nodiscard]] std::uint64_t bytesTaken() const { return bytesTaken_; }

    /// Returns the number to acknowledge: all segments up to it were taken.
    [[nodiscard]] std::uint64_t taken() const { return next_ - 1; }
    /// Returns the time when an acknowledgement is due, or nothing if the sender has all.
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
