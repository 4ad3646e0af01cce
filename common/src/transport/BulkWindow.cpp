// Limits the bulk data on its way to what the line carries in a moment (TL1).
#include "usdlive/common/transport/BulkWindow.h"

#include <algorithm>
#include <charconv>

namespace usdlive {

namespace {

// Further marks are not measured. A peer that acknowledges nothing gets no more bulk data anyway.
constexpr std::size_t kMostMarks = 1'024;
// Bulk data pauses so often, until what is on the way has arrived.
constexpr std::chrono::seconds kBaseTime{10};
constexpr std::chrono::hours kLongestBase{1};

}  // namespace

std::uint64_t BulkWindow::mark(TimePoint now) {
    if (baseSince_ == TimePoint()) baseSince_ = now;
    if (marks_.size() < kMostMarks) marks_.push_back({sent_, sent_ - acknowledged_, now});
    return marked_ = sent_;
}

void BulkWindow::acknowledged(std::uint64_t mark, TimePoint now) {
    if (mark < acknowledged_ || mark > marked_) return;
    const std::uint64_t arrived = mark - acknowledged_;
    std::optional<Mark> last;
    for (; !marks_.empty() && marks_.front().position <= mark; marks_.pop_front())
        last = marks_.front();
    if (last) adapt(*last, arrived, now);
    acknowledged_ = mark;
    if (last) measureAgain(*last, now);
}

/// A line's own time can grow, for example when it takes another way. While there is always a
/// queue, only a pause shows it.
void BulkWindow::measureAgain(const Mark& mark, TimePoint now) {
    if (!pauseUntil_ && now - baseSince_ >= kBaseTime && mark.onTheWay * 2 >= limit_)
        pauseUntil_ = marked_;
    if (pauseUntil_ && acknowledged_ >= *pauseUntil_) {
        pauseUntil_.reset();
        base_ = kLongestBase;
        baseSince_ = now;
    }
}

/// The bytes on the way arrived in `took`, so the line carried them at this rate. Without a queue
/// the rate is not the line's, and the window grows: at first it doubles in the time of one way and
/// back, later it grows by an eighth, because a queue is noticed only so late.
void BulkWindow::adapt(const Mark& mark, std::uint64_t arrived, TimePoint now) {
    using Seconds = std::chrono::duration<double>;
    const std::chrono::nanoseconds took = now - mark.time;
    base_ = std::min(base_, took);
    const auto allowed = base_ + kQueueTime;
    if (took > allowed) {
        const double carried = double(mark.onTheWay) * (Seconds(allowed) / Seconds(took));
        limit_ = std::clamp(std::size_t(carried), kLeast, limit_);
        wasFull_ = true;
    } else if (mark.onTheWay * 2 >= limit_) {
        limit_ = std::min<std::size_t>(kMost, limit_ + (wasFull_ ? arrived / 8 : arrived));
    }
}

std::string pingPayload(std::uint64_t mark) { return std::to_string(mark); }

std::optional<std::uint64_t> markOf(std::string_view payload) {
    std::uint64_t mark = 0;
    const char* const end = payload.data() + payload.size();
    const auto [read, error] = std::from_chars(payload.data(), end, mark);
    return error == std::errc{} && read == end ? std::optional(mark) : std::nullopt;
}

}  // namespace usdlive
