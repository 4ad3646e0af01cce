// Tests streams of segments over a bad network (DD4).
#include <gtest/gtest.h>

#include <map>
#include <random>
#include <string>

#include "usdlive/common/dds/SegmentReceiver.h"
#include "usdlive/common/dds/SegmentSender.h"

using namespace usdlive;
using namespace usdlive::dds;
using namespace std::chrono_literals;

namespace {

SharedBytes bytes(std::string_view text) {
    const auto view = asBytes(text);
    return std::make_shared<const Bytes>(view.begin(), view.end());
}
SharedBytes bytes(std::size_t size, std::uint8_t value) {
    return std::make_shared<const Bytes>(size, value);
}

const TimePoint kStart{};

}  // namespace

TEST(SegmentSender, DD4JoinsSmallMessagesAndCutsLargeOnes) {
    SegmentSender sender;
    sender.push(bytes("one"));
    sender.push(bytes("two"));
    sender.push(bytes(2 * kSegmentBytes + 10, 7));
    const auto segments = sender.take(kStart);
    ASSERT_EQ(segments.size(), 4u);
    EXPECT_EQ(asText(segments[0].bytes), "onetwo");
    EXPECT_FALSE(segments[0].more);
    EXPECT_TRUE(segments[1].more && segments[2].more && !segments[3].more);
    EXPECT_EQ(segments[3].bytes.size(), 10u);
    EXPECT_EQ(segments[3].sequence, 4u);
}

TEST(SegmentSender, DD6DoesNotJoinAcrossMarks) {
    SegmentSender sender;
    sender.push(bytes("a"), {5});
    sender.push(nullptr, {5, true});
    sender.push(bytes("b"), {5});
    sender.push(nullptr, {5, false, 9});
    sender.push(bytes("c"), {9});
    const auto segments = sender.take(kStart);
    ASSERT_EQ(segments.size(), 3u);
    EXPECT_EQ(segments[0].mark, (StreamMark{5}));
    EXPECT_EQ(segments[1].mark, (StreamMark{5, true, 9}));
    EXPECT_EQ(asText(segments[1].bytes), "b");
    EXPECT_EQ(segments[2].mark, (StreamMark{9}));
}

TEST(SegmentSender, DD4StopsAtTheWindow) {
    SegmentSender sender;
    for (int index = 0; index < 40; ++index) sender.push(bytes(kSegmentBytes, 1));
    EXPECT_EQ(sender.take(kStart).size(), kWindowBytes / kSegmentBytes);
    EXPECT_TRUE(sender.take(kStart).empty());
    EXPECT_EQ(sender.queuedBytes(), 40 * kSegmentBytes);
    EXPECT_TRUE(sender.acknowledged(3, kStart));
    EXPECT_FALSE(sender.acknowledged(3, kStart));
    EXPECT_FALSE(sender.acknowledged(1'000, kStart)) << "no such message was sent";
    EXPECT_EQ(sender.take(kStart).size(), 3u);
}

TEST(SegmentSender, DD4SendsAgainWhatIsNotAcknowledgedLessAndLessOften) {
    SegmentSender sender;
    sender.push(bytes("a"));
    ASSERT_EQ(sender.take(kStart).size(), 1u);
    EXPECT_TRUE(sender.take(kStart + SegmentSender::kFirstTimeout - 1ms).empty());
    int sent = 0;
    for (auto time = 0ms; time < 60s; time += 5ms) sent += int(sender.take(kStart + time).size());
    EXPECT_GT(sent, 20);
    EXPECT_LT(sent, 60);
    EXPECT_EQ(sender.stalledSince(), kStart);
    EXPECT_TRUE(sender.acknowledged(1, kStart + 60s));
    EXPECT_TRUE(sender.isEmpty());
    EXPECT_EQ(sender.deadline(), std::nullopt);
    EXPECT_EQ(sender.stalledSince(), std::nullopt);
}

TEST(SegmentSender, KeepsAPartlySentMessageComplete) {
    SegmentSender sender;
    sender.push(bytes(kWindowBytes + kSegmentBytes, 3));
    sender.push(bytes("later"));
    static_cast<void>(sender.take(kStart));
    sender.dropWaiting();
    sender.push(bytes("error"));
    sender.pushEnd();
    EXPECT_TRUE(sender.acknowledged(kWindowBytes / kSegmentBytes, kStart));
    const auto rest = sender.take(kStart);
    ASSERT_EQ(rest.size(), 2u);
    EXPECT_EQ(rest[0].bytes.size(), kSegmentBytes);
    EXPECT_EQ(asText(rest[1].bytes), "error");
    EXPECT_TRUE(rest[1].end);
}

TEST(SegmentReceiver, DD4BoundsWhatItKeeps) {
    SegmentReceiver receiver(3 * kSegmentBytes);
    const auto segment = [](std::uint64_t sequence, std::size_t size, bool more = false) {
        Segment made;
        made.sequence = sequence;
        made.owner = bytes(size, 1);
        made.bytes = *made.owner;
        made.more = more;
        return made;
    };
    EXPECT_FALSE(receiver.received(segment(1 + kWindowSegments, 1), kStart));
    EXPECT_FALSE(receiver.received(segment(1, kSegmentBytes + 1), kStart));
    std::size_t kept = 0;
    for (std::uint64_t sequence = 2; sequence < 100; ++sequence)
        kept += receiver.received(segment(sequence, kSegmentBytes), kStart);
    EXPECT_EQ(kept, 2 * kWindowBytes / kSegmentBytes);

    SegmentReceiver small(3 * kSegmentBytes);
    for (std::uint64_t sequence = 1; sequence <= 4; ++sequence)
        EXPECT_TRUE(small.received(segment(sequence, kSegmentBytes, true), kStart));
    EXPECT_FALSE(small.take(kStart));
    EXPECT_TRUE(small.isTooLarge());
    EXPECT_EQ(small.next(), std::nullopt);
}

// Two ends, and between them a network that loses, duplicates and reorders samples both ways.
TEST(SegmentStream, DD4DeliversEverythingInOrderOverABadNetwork) {
    for (unsigned seed = 0; seed < 60; ++seed) {
        SCOPED_TRACE(seed);
        std::mt19937 random{seed};
        const unsigned lossPercent = seed % 4 * 15;
        SegmentSender sender;
        SegmentReceiver receiver(8 * 1024 * 1024);
        Bytes sent, arrived;
        std::multimap<TimePoint, Segment> segments;
        std::multimap<TimePoint, std::uint64_t> acks;
        const auto travel = [&](TimePoint now, auto& way, const auto& what) {
            for (int copies = random() % 10 == 0 ? 2 : 1; copies > 0; --copies)
                if (random() % 100 >= lossPercent)
                    way.emplace(now + std::chrono::milliseconds(random() % 30), what);
        };
        int left = 300;
        bool ended = false;
        TimePoint now = kStart;
        std::uint64_t inFlight = 0;
        for (; !ended && now < kStart + 600s; now += 1ms) {
            for (int count = int(random() % 3); count > 0 && left > 0; --count, --left) {
                const std::size_t size =
                    random() % 40 == 0 ? random() % 2'000'000 : 1 + random() % 2'000;
                const auto message = bytes(size, std::uint8_t(random()));
                sent.insert(sent.end(), message->begin(), message->end());
                sender.push(message);
                if (left == 1) sender.pushEnd();
            }
            for (const Segment& segment : sender.take(now)) {
                if (segment.sequence > receiver.taken())
                    inFlight = std::max(inFlight, segment.sequence - receiver.taken());
                travel(now, segments, segment);
            }
            for (; !segments.empty() && segments.begin()->first <= now;
                 segments.erase(segments.begin()))
                receiver.received(segments.begin()->second, now);
            while (const auto message = receiver.take(now)) {
                if (message->bytes)
                    arrived.insert(arrived.end(), message->bytes->begin(), message->bytes->end());
                ended = ended || message->end;
            }
            if (receiver.ackDue() && *receiver.ackDue() <= now) {
                travel(now, acks, receiver.taken());
                receiver.ackSent();
            }
            for (; !acks.empty() && acks.begin()->first <= now; acks.erase(acks.begin()))
                sender.acknowledged(acks.begin()->second, now);
        }
        EXPECT_TRUE(ended);
        EXPECT_EQ(arrived, sent);
        EXPECT_EQ(receiver.bytesTaken(), sent.size());
        EXPECT_LE(inFlight, kWindowSegments);
    }
}
