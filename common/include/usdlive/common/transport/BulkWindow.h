// Limits the bulk data on its way to what the line carries in a moment.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <string>
#include <string_view>

namespace usdlive {

/// TL1: the amount of data that may be on its way before big values, files and snapshots wait. It
/// follows the rate at which the peer acknowledges: about what the line carries in kQueueTime, so
/// that an edit does not wait longer than that behind them, whatever buffers are on the way.
///
/// Count what is queued and sent, let the peer acknowledge marks, and send parts of partBytes().
/// Copyable; no I/O; not thread safe.
class BulkWindow {
public:
    using TimePoint = std::chrono::steady_clock::time_point;
    /// The time that the data of the window waits on the way, beyond the time of an empty line.
    static constexpr std::chrono::milliseconds kQueueTime{250};
    static constexpr std::size_t kLeast = 16 * 1024;
    static constexpr std::size_t kFirst = 128 * 1024;
    static constexpr std::size_t kMost = 4 * 1024 * 1024;
    /// The smallest and the largest part of bulk data.
    static constexpr std::size_t kLeastPart = 8 * 1024;
    static constexpr std::size_t kMostPart = 256 * 1024;

    void queued(std::size_t bytes) { queued_ += bytes; }
    /// Call when queued data was written to the line.
    void sent(std::size_t bytes) { sent_ += bytes; }
    /// Returns whether enough was sent since the last mark to be worth another one. Ask when
    /// something was sent or acknowledged.
    [[nodiscard]] bool wantsMark() const { return sent_ - marked_ >= part(); }
    /// Marks the end of what was sent. The peer acknowledges the returned number.
    std::uint64_t mark(TimePoint now);
    /// Call when the peer has acknowledged everything up to a mark. Ignores numbers that are not
    /// of a mark.
    void acknowledged(std::uint64_t mark, TimePoint now);

    /// Returns the size of the next part of bulk data; 0: it has to wait.
    [[nodiscard]] std::size_t partBytes() const {
        return !pauseUntil_ && outstanding() < limit_ ? part() : 0;
    }
    /// Returns the bytes that were queued and are not known to have arrived.
    [[nodiscard]] std::size_t outstanding() const { return std::size_t(queued_ - acknowledged_); }
    [[nodiscard]] std::size_t limit() const { return limit_; }

private:
    struct Mark {
        std::uint64_t position = 0;
        std::uint64_t onTheWay = 0;  ///< sent and not acknowledged then
        TimePoint time;
    };
    [[nodiscard]] std::size_t part() const { return std::clamp(limit_ / 4, kLeastPart, kMostPart); }
    void adapt(const Mark& mark, std::uint64_t arrived, TimePoint now);
    void measureAgain(const Mark& mark, TimePoint now);

    // Positions in the stream of bytes.
    std::uint64_t queued_ = 0, sent_ = 0, marked_ = 0, acknowledged_ = 0;
    std::deque<Mark> marks_;
    std::size_t limit_ = kFirst;
    bool wasFull_ = false;  ///< the line had a queue once
    /// The shortest time until an acknowledgement: that of the line without a queue. A line whose
    /// first acknowledgement takes longer than this is assumed to have a queue.
    std::chrono::nanoseconds base_ = std::chrono::milliseconds(500);
    TimePoint baseSince_;
    std::optional<std::uint64_t> pauseUntil_;  ///< this mark is acknowledged
};

/// A mark as the payload of a WebSocket ping, which the peer repeats in its pong.
[[nodiscard]] std::string pingPayload(std::uint64_t mark);
/// Returns nothing for a payload that is not of pingPayload().
[[nodiscard]] std::optional<std::uint64_t> markOf(std::string_view payload);

}  // namespace usdlive
