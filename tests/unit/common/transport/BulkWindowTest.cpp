// Tests the window of bulk data (TL1) on lines of any rate, delay, jitter and buffer, in virtual
// time.
#include "usdlive/common/transport/BulkWindow.h"

#include <gtest/gtest.h>

#include <deque>
#include <random>

using namespace usdlive;
using namespace std::chrono_literals;

namespace {

using TimePoint = BulkWindow::TimePoint;
using Seconds = std::chrono::duration<double>;

/// A line that carries bytes one after the other, whatever waits for it, and answers marks.
class Line {
public:
    double bytesPerSecond = 125'000;
    std::chrono::microseconds delay{20'000};  ///< one way
    std::chrono::microseconds jitter{0};

    /// Sends bytes at `now`. Returns the time when the acknowledgement of them arrives.
    TimePoint send(std::size_t bytes, TimePoint now) {
        const auto takes = std::chrono::duration_cast<std::chrono::nanoseconds>(
            Seconds(double(bytes) / bytesPerSecond));
        free_ = std::max(free_, now) + takes;
        const auto late = std::chrono::microseconds(
            jitter.count() == 0 ? 0 : random_() % std::uint64_t(jitter.count()));
        return arrived_ = std::max(arrived_, free_ + 2 * delay + late);  // TCP keeps the order
    }
    /// How long something waits that is sent now, beyond the delay.
    [[nodiscard]] std::chrono::milliseconds queue(TimePoint now) const {
        return std::chrono::duration_cast<std::chrono::milliseconds>(std::max(free_, now) - now);
    }
    std::mt19937_64 random_{1};

private:
    TimePoint free_, arrived_;
};

/// Sends bulk data over a line as fast as the window allows, in frames of 16 ms, with an edit in
/// each frame.
struct Upload {
    Line& line;
    BulkWindow window = {};
    TimePoint now = TimePoint(1h);
    std::size_t editBytes = 300;
    std::deque<std::pair<TimePoint, std::uint64_t>> marks = {};
    std::chrono::milliseconds longestWait{0};
    std::size_t sent = 0;

    explicit Upload(Line& carrier) : line(carrier) { mark(0); }

    void mark(std::size_t bytes) { marks.emplace_back(line.send(bytes, now), window.mark(now)); }
    void write(std::size_t bytes) {
        window.queued(bytes);
        window.sent(bytes);
        if (window.wantsMark())
            mark(bytes);
        else
            line.send(bytes, now);
    }
    void frame() {
        now += 16ms;
        for (; !marks.empty() && marks.front().first <= now; marks.pop_front())
            window.acknowledged(marks.front().second, marks.front().first);
        longestWait = std::max(longestWait, line.queue(now));
        write(editBytes);
        for (std::size_t part; (part = window.partBytes()) > 0 && part <= 4'000'000; sent += part) {
            write(part);
            if (sent > 500'000'000) return;
        }
    }
    void run(std::chrono::milliseconds time) {
        longestWait = 0ms;
        sent = 0;
        for (const TimePoint end = now + time; now < end;) frame();
    }
};

TEST(BulkWindow, TL1FollowsTheRateOfTheLine) {
    for (const double megabits : {1.0, 2.0, 10.0, 100.0}) {
        SCOPED_TRACE(megabits);
        Line line;
        line.bytesPerSecond = megabits * 125'000;
        Upload upload(line);
        upload.run(5s);
        EXPECT_LT(upload.longestWait, 1'500ms) << "the first window";
        upload.run(30s);
        EXPECT_LT(upload.longestWait, 500ms);
        // The edits take up to 150 kbit/s of it.
        EXPECT_GT(double(upload.sent + 30 * 60 * 300), 0.85 * 30 * line.bytesPerSecond);
    }
}

TEST(BulkWindow, TL1TheThinnestLineKeepsMoving) {
    Line line;
    line.bytesPerSecond = 12'500;
    Upload upload(line);
    upload.editBytes = 0;
    upload.run(20s);
    upload.run(60s);
    EXPECT_LT(upload.longestWait, 2'500ms);
    EXPECT_GT(double(upload.sent), 0.85 * 60 * line.bytesPerSecond);
}

// Random lines, which also change while they are used.
TEST(BulkWindow, TL1HoldsForAnyLine) {
    for (unsigned seed = 0; seed < 300; ++seed) {
        SCOPED_TRACE(seed);
        std::mt19937 random{seed};
        const auto between = [&](double least, double most) {
            return std::exp(
                std::uniform_real_distribution(std::log(least), std::log(most))(random));
        };
        Line line;
        line.random_.seed(seed);
        Upload upload(line);
        for (int part = 0; part < 3; ++part) {
            line.bytesPerSecond = between(125'000, 12'500'000);
            line.delay = std::chrono::microseconds(int(between(100, 300'000)));
            line.jitter = std::chrono::microseconds(int(between(1, 100'000)));
            upload.run(60s);  // it may have become slower while much was on the way
            upload.run(20s);
            EXPECT_LT(upload.longestWait, 1'200ms);
            EXPECT_GT(double(upload.sent + 20 * 60 * 300),
                      0.6 * 20 * std::min(line.bytesPerSecond, 2'500'000.0))
                << line.bytesPerSecond << " bytes/s, " << line.delay.count() << " us";
        }
    }
}

TEST(BulkWindow, TL1WaitsWhenNothingIsAcknowledged) {
    BulkWindow window;
    std::size_t sent = 0;
    for (std::size_t part; (part = window.partBytes()) > 0; sent += part) {
        window.queued(part);
        window.sent(part);
        (void)window.mark(TimePoint(1s));
    }
    EXPECT_GE(sent, BulkWindow::kFirst);
    EXPECT_LT(sent, BulkWindow::kFirst + BulkWindow::kMostPart);
    EXPECT_EQ(window.outstanding(), sent);
}

// Frames that were made for another purpose, one at a time.
TEST(BulkWindow, TL1PartsThatAreLargerThanTheWindowDoNotStopIt) {
    BulkWindow window;
    TimePoint now(1h);
    for (int part = 0; part < 1'000; ++part, now += 50ms) {
        ASSERT_GT(window.partBytes(), 0u) << part;
        window.queued(300'000);
        window.sent(300'000);
        window.acknowledged(window.mark(now), now + 40ms);
    }
}

// A shorter window than what is on the way without a mark must not stop everything.
TEST(BulkWindow, TL1AsksForAMarkWhenTheWindowShrinks) {
    BulkWindow window;
    window.queued(60'000);
    window.sent(60'000);
    const auto mark = window.mark(TimePoint(1s));
    window.queued(30'000);
    window.sent(30'000);
    EXPECT_FALSE(window.wantsMark());
    window.acknowledged(mark, TimePoint(30s));
    EXPECT_EQ(window.limit(), BulkWindow::kLeast);
    EXPECT_EQ(window.partBytes(), 0u);
    EXPECT_TRUE(window.wantsMark());
}

TEST(BulkWindow, TL1IgnoresWhatIsNoMark) {
    BulkWindow window;
    window.queued(10'000);
    window.sent(10'000);
    (void)window.mark(TimePoint(1s));
    window.acknowledged(10'001, TimePoint(2s));
    window.acknowledged(~0ull, TimePoint(2s));
    EXPECT_EQ(window.outstanding(), 10'000u);
    window.acknowledged(10'000, TimePoint(2s));
    window.acknowledged(10'000, TimePoint(3s));
    window.acknowledged(0, TimePoint(3s));
    EXPECT_EQ(window.outstanding(), 0u);
    EXPECT_EQ(markOf(pingPayload(~0ull)), ~0ull);
    for (const char* payload : {"", "x", "1x", "-1", "99999999999999999999999"})
        EXPECT_FALSE(markOf(payload)) << payload;
}

}  // namespace
