// Tests CommitOrder: commits of the topic and the stream of a session, in one order.
#include "transport/CommitOrder.h"

#include <gtest/gtest.h>

#include <map>
#include <random>
#include <string>

#include "usdlive/common/dds/SegmentSender.h"

using namespace usdlive;
using namespace std::chrono_literals;
using client::CommitOrder;
using dds::Segment;
using dds::SegmentSender;
using dds::StreamMark;
using dds::TimePoint;

namespace {

const TimePoint kStart{};

SharedBytes bytes(std::string_view text) {
    const auto view = asBytes(text);
    return std::make_shared<const Bytes>(view.begin(), view.end());
}

std::vector<std::string> taken(CommitOrder& order, TimePoint now = kStart) {
    std::vector<std::string> texts;
    while (const auto message = order.take(now))
        if (message->bytes) texts.emplace_back(asText(*message->bytes));
    return texts;
}

class CommitOrderTest : public testing::Test {
protected:
    void reply(std::string_view text, StreamMark mark) {
        Segment segment;
        segment.sequence = ++sequence_;
        segment.mark = mark;
        segment.owner = bytes(text);
        segment.bytes = *segment.owner;
        order_.replies().received(std::move(segment), kStart);
    }
    void commit(Revision revision, std::uint64_t position = 0) {
        order_.commit(revision, position, bytes("c" + std::to_string(revision)));
    }

    CommitOrder order_{1'000'000};
    std::uint64_t sequence_ = 0;
};

using Texts = std::vector<std::string>;

}  // namespace

TEST_F(CommitOrderTest, DD6CommitsWaitUntilTheStreamIsLive) {
    commit(4);
    commit(5);
    commit(6);
    EXPECT_EQ(taken(order_), Texts{});
    reply("welcome", {0, false, 5});
    EXPECT_EQ(taken(order_), (Texts{"welcome", "c5", "c6"}));
    commit(6);
    commit(7);
    EXPECT_EQ(taken(order_), Texts{"c7"});
}

TEST_F(CommitOrderTest, DD5AReplyWaitsForTheCommitBeforeIt) {
    reply("live", {0, false, 5});
    reply("after 5", {5});
    EXPECT_EQ(taken(order_), Texts{"live"});
    commit(6);
    EXPECT_EQ(taken(order_), Texts{});
    commit(5);
    EXPECT_EQ(taken(order_), (Texts{"c5", "after 5", "c6"}));
}

TEST_F(CommitOrderTest, DD5ACommitWaitsForTheRepliesBeforeIt) {
    reply("live", {0, false, 5});
    commit(5, 4 + 7);
    commit(6);
    EXPECT_EQ(taken(order_), Texts{"live"});
    reply("preview", {0});
    EXPECT_EQ(taken(order_), (Texts{"preview", "c5", "c6"}));
}

TEST_F(CommitOrderTest, DD6NoCommitIsInsideALog) {
    reply("live", {0, false, 5});
    reply("log", {0, true});
    commit(5);
    reply("past", {});
    EXPECT_EQ(taken(order_), (Texts{"live", "log", "past"}));
    reply("", {0, false, 6});
    commit(6);
    EXPECT_EQ(taken(order_), (Texts{"", "c6"}));
}

TEST_F(CommitOrderTest, DD7RequestsMissingCommitsAfterAWhile) {
    reply("live", {0, false, 5});
    EXPECT_EQ(taken(order_), Texts{"live"});
    EXPECT_EQ(order_.deadline(), std::nullopt);
    commit(8);
    EXPECT_EQ(taken(order_), Texts{});
    EXPECT_FALSE(order_.nextRequest(kStart + 99ms));
    const auto asked = order_.nextRequest(kStart + 100ms);
    ASSERT_TRUE(asked);
    EXPECT_EQ(asked->from, 5u);
    EXPECT_EQ(asked->to, 7u);
    EXPECT_FALSE(order_.nextRequest(kStart + 150ms));
    EXPECT_TRUE(order_.nextRequest(kStart + 200ms)) << "a missing commit is requested again";
    for (const Revision revision : {7, 6, 5}) commit(revision);
    EXPECT_EQ(taken(order_), (Texts{"c5", "c6", "c7", "c8"}));
    EXPECT_EQ(order_.deadline(), std::nullopt);
}

TEST_F(CommitOrderTest, DD7TheLastCommitIsMissedToo) {
    reply("live", {0, false, 5});
    EXPECT_EQ(taken(order_), Texts{"live"});
    order_.sent(5);  // like a keep-alive
    EXPECT_EQ(taken(order_), Texts{});
    const auto asked = order_.nextRequest(kStart + 100ms);
    ASSERT_TRUE(asked);
    EXPECT_EQ(asked->to, 5u);
}

TEST_F(CommitOrderTest, BoundsWhatItKeeps) {
    for (Revision revision = 1; revision <= 3'000; ++revision) commit(revision);
    reply("live", {0, false, 2'990});
    EXPECT_EQ(taken(order_).size(), 12u) << "before it is live, the oldest are dropped";
    for (Revision revision = 3'002; revision <= 6'000; ++revision) commit(revision);
    commit(3'001);
    EXPECT_EQ(taken(order_).size(), CommitOrder::kHeldCommits) << "then the newest";
    ASSERT_TRUE(order_.deadline());
}

// A server that sends everything that a project does, and a network that loses, duplicates and
// reorders the samples of both topics. The messages must arrive in the order in which they were
// sent.
TEST(CommitOrder, DD5ToDD7HoldOverABadNetwork) {
    for (unsigned seed = 0; seed < 200; ++seed) {
        SCOPED_TRACE(seed);
        std::mt19937 random{seed};
        const unsigned lossPercent = seed % 4 * 10;
        CommitOrder order(1'000'000);
        SegmentSender sender;
        struct Sent {
            Revision revision;
            std::uint64_t position;
        };
        std::multimap<TimePoint, Segment> segments;
        std::multimap<TimePoint, Sent> commits;
        std::multimap<TimePoint, std::uint64_t> acks;
        std::multimap<TimePoint, CommitOrder::Range> requests;
        const auto travel = [&](TimePoint now, auto& way, const auto& what) {
            for (int copies = random() % 10 == 0 ? 2 : 1; copies > 0; --copies)
                if (random() % 100 >= lossPercent)
                    way.emplace(now + std::chrono::milliseconds(random() % 40), what);
        };

        // The server's side, as DdsSession implements it.
        std::vector<std::string> expected, got;
        std::map<Revision, std::uint64_t> positions;
        Revision head = random() % 10, last = 0;
        bool live = false, notified = false;
        std::uint64_t position = 0;
        int replies = 0;
        const auto push = [&](const std::string& text, StreamMark mark) {
            position += text.size();
            sender.push(bytes(text), mark);
            expected.push_back(text);
        };
        Revision heldSince = head;
        const auto act = [&](TimePoint now) {
            switch (random() % 12) {
                case 0:
                    if (live) {
                        sender.push(nullptr, {last, true});
                        live = false;
                        heldSince = last;
                        push("[log]", {last});
                    }
                    break;
                case 1:
                case 2:
                    if (!live) {  // the commits that it missed, one by one
                        for (Revision past = heldSince + 1; past <= head; ++past)
                            push("p" + std::to_string(past), {last});
                        live = true;
                        notified = false;
                    }
                    break;
                case 3:
                case 4:
                    push("r" + std::to_string(++replies), {last});
                    break;
                default:
                    ++head;
                    if (live) {
                        if (!notified) sender.push(nullptr, {last, false, head});
                        notified = true;
                        last = head;
                        expected.push_back("c" + std::to_string(head));
                    }
                    positions[head] = position;
                    travel(now, commits, Sent{head, position});
            }
        };

        int actions = 300;
        TimePoint now = kStart;
        for (; now < kStart + 300s; now += 1ms) {
            if (actions > 0 && random() % 2 == 0) {
                act(now);
                if (--actions == 0) push("done", {last});
            }
            for (const Segment& segment : sender.take(now)) travel(now, segments, segment);
            for (; !segments.empty() && segments.begin()->first <= now;
                 segments.erase(segments.begin()))
                order.replies().received(segments.begin()->second, now);
            for (; !commits.empty() && commits.begin()->first <= now;
                 commits.erase(commits.begin())) {
                const auto& [revision, at] = commits.begin()->second;
                order.commit(revision, at, bytes("c" + std::to_string(revision)));
            }
            while (const auto message = order.take(now))
                if (message->bytes) got.emplace_back(asText(*message->bytes));
            if (const auto range = order.nextRequest(now)) travel(now, requests, *range);
            for (; !requests.empty() && requests.begin()->first <= now;
                 requests.erase(requests.begin()))
                for (Revision revision = requests.begin()->second.from;
                     revision <= std::min(head, requests.begin()->second.to); ++revision)
                    travel(now, commits, Sent{revision, positions[revision]});
            if (const auto due = order.ackDue(); due && *due <= now) {
                travel(now, acks, order.replies().taken());
                order.replies().ackSent();
            }
            for (; !acks.empty() && acks.begin()->first <= now; acks.erase(acks.begin()))
                sender.acknowledged(acks.begin()->second, now);
            if (actions == 0 && sender.isEmpty()) break;
        }

        // Messages that were sent in one segment arrive as one. While the server is busy with a
        // log, it does not count a commit for the session; the commit may arrive before the log,
        // and again in it.
        std::string all, wanted;
        for (std::size_t index = 0, at = 0; index < got.size(); ++index) {
            while (at < expected.size() && wanted.size() < all.size() + got[index].size() &&
                   got[index][0] != 'c')
                wanted += expected[at++];
            if (got[index][0] == 'c') {
                if (at < expected.size() && expected[at] == got[index])
                    wanted += expected[at++];
                else
                    continue;  // too early
            }
            all += got[index];
        }
        EXPECT_EQ(all, wanted);
        ASSERT_FALSE(got.empty());
        EXPECT_TRUE(got.back().ends_with("done"));
        EXPECT_TRUE(sender.isEmpty());
    }
}
