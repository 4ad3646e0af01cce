// Tests when a peer is sent a ping and when it is lost (SE7).
#include "usdlive/common/transport/PeerLife.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <optional>

using namespace usdlive;
using namespace std::chrono_literals;

namespace {

using Verdict = PeerLife::Verdict;
using TimePoint = PeerLife::TimePoint;

constexpr auto kLongest = 14s;

/// A connection that is looked at twice a second.
class PeerLifeTest : public testing::Test {
protected:
    /// Time passes. `each` is called every half a second. Returns the time when the peer is lost.
    std::optional<std::chrono::milliseconds> pass(
        std::chrono::milliseconds time, const std::function<void()>& each = [] {}) {
        for (const TimePoint end = now_ + time; now_ < end;) {
            now_ += 500ms;
            each();
            const Verdict verdict = life_.check(sent_, now_);
            if (verdict == Verdict::Lost)
                return duration_cast<std::chrono::milliseconds>(now_ - start_);
            if (verdict == Verdict::SendPing) {
                ++pings_;
                if (writesPings_) writePing();
            }
        }
        return std::nullopt;
    }
    void writePing() {
        sent_.waiting += 6;
        life_.pingWritten(sent_);
    }
    void take(std::uint64_t bytes) {
        bytes = std::min(bytes, sent_.waiting);
        sent_.waiting -= bytes;
        sent_.acknowledged += bytes;
    }

    const TimePoint start_{};
    TimePoint now_ = start_;
    PeerLife life_{kLongest, start_};
    SendProgress sent_;
    int pings_ = 0;
    bool writesPings_ = true;
};

TEST_F(PeerLifeTest, SE7APeerThatAnswersPingsStays) {
    EXPECT_FALSE(pass(100s, [&] {
        take(1'000);
        if (pings_ > 0) life_.received(now_);
    }));
    EXPECT_GT(pings_, 0);
}

TEST_F(PeerLifeTest, SE7APeerThatTakesAndAnswersNothingIsLost) {
    sent_.waiting = 1'000'000;
    const auto lost = pass(100s);
    ASSERT_TRUE(lost);
    EXPECT_LE(*lost, 15s);
    EXPECT_EQ(pings_, 1);
}

// The system of a stopped process takes what is sent to it, and answers no ping.
TEST_F(PeerLifeTest, SE7AStoppedProcessIsLost) {
    const auto lost = pass(100s, [&] {
        sent_.waiting += 500;
        take(1'000);
    });
    ASSERT_TRUE(lost);
    EXPECT_LE(*lost, 15s);
}

// 6 MB on a line of 0.1 Mbit/s, in the system's buffers before the ping: 480 s.
TEST_F(PeerLifeTest, SE7BytesThatMoveAreLife) {
    sent_.waiting = 6'000'000;
    EXPECT_FALSE(pass(470s, [&] { take(6'250); }));
    EXPECT_EQ(pings_, 1);
    // The line gets stuck: the ping is still behind other data.
    const auto lost = pass(100s);
    ASSERT_TRUE(lost);
    EXPECT_LE(*lost, 470s + 15s);
}

// The ping waits in this process, behind a message that is being written.
TEST_F(PeerLifeTest, SE7APingThatCannotBeWrittenYetWaits) {
    writesPings_ = false;
    sent_.waiting = 2'000'000;
    EXPECT_FALSE(pass(100s, [&] { take(6'250); }));
    writePing();
    EXPECT_FALSE(pass(6s));
    EXPECT_TRUE(pass(2s));
}

// A machine that slept, or a busy thread, looks again after a long time.
TEST_F(PeerLifeTest, SE7ThePeerHasTimeToAnswerThePing) {
    now_ += 1h;
    EXPECT_EQ(life_.check(sent_, now_), Verdict::SendPing);
    EXPECT_FALSE(pass(6s));
    life_.received(now_);
    EXPECT_FALSE(pass(13s));
}

TEST_F(PeerLifeTest, SE7WorksWithoutKnowledgeOfTheSocket) {
    EXPECT_EQ(life_.check({}, now_ + 7s), Verdict::SendPing);
    life_.pingWritten({});
    EXPECT_EQ(life_.check({}, now_ + 13s), Verdict::Alive);
    EXPECT_EQ(life_.check({}, now_ + 14s), Verdict::Lost);
}

}  // namespace
