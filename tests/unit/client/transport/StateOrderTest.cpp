// Tests StateOrder: layer states and presences of the DDS topics, in order with the commits.
#include "transport/StateOrder.h"

#include <gtest/gtest.h>

#include <string>

#include "unit/common/protocol/SampleStates.h"

using namespace usdlive;
using namespace std::chrono_literals;
using client::CommitOrder;
using client::StateOrder;
using dds::Segment;
using dds::TimePoint;
using tests::presenceOf;
using tests::stateOf;

namespace {

const TimePoint kNow = TimePoint{} + 1h;

std::string text(const LayerStates& states) {
    std::string text;
    for (const LayerState& state : states.layers)
        text += state.layer.value + std::to_string(state.saved) + " ";
    return text;
}

std::string text(const Presences& people) {
    std::string text;
    for (const Presence& shown : people.shown)
        text += shown.client.value + std::to_string(int(*shown.time)) + " ";
    for (const ClientId& gone : people.gone) text += "-" + gone.value + " ";
    return text;
}

/// Takes commits from the topic, from `next` on.
CommitOrder liveFrom(Revision next) {
    CommitOrder commits(1'000);
    Segment segment;
    segment.sequence = 1;
    segment.mark.liveFrom = next;
    commits.replies().received(std::move(segment), kNow);
    (void)commits.take(kNow);
    return commits;
}

}  // namespace

TEST(StateOrder, DD11NothingIsShownBeforeTheStreamNamesTheStart) {
    const CommitOrder commits = liveFrom(1);
    StateOrder order;
    order.state(3, 0, stateOf("a", 3));
    order.state(5, 0, stateOf("b", 5));
    EXPECT_EQ(text(order.takeStates(commits)), "");
    order.statesFrom(4);  // layer a is in the states of the stream
    EXPECT_EQ(text(order.takeStates(commits)), "b5 ");
    order.state(2, 0, stateOf("c", 2));
    EXPECT_EQ(text(order.takeStates(commits)), "");
}

TEST(StateOrder, DD11TheLatestStateIsShownOnce) {
    const CommitOrder commits = liveFrom(1);
    StateOrder order;
    order.statesFrom(1);
    order.state(1, 0, stateOf("a", 1));
    order.state(2, 0, stateOf("a", 2));
    order.state(1, 0, stateOf("a", 1));  // too late
    EXPECT_EQ(text(order.takeStates(commits)), "a2 ");
    order.state(2, 0, stateOf("a", 2));  // DDS delivers it again to a reader that was away
    EXPECT_EQ(text(order.takeStates(commits)), "");
}

TEST(StateOrder, LS1AStateWaitsForItsCommit) {
    CommitOrder commits = liveFrom(7);
    StateOrder order;
    order.statesFrom(1);
    order.state(1, 6, stateOf("a", 1));
    order.state(2, 8, stateOf("b", 2));
    EXPECT_EQ(text(order.takeStates(commits)), "a1 ");
    commits.commit(7, 0, std::make_shared<const Bytes>(Bytes{1}));
    ASSERT_TRUE(commits.take(kNow));
    EXPECT_EQ(text(order.takeStates(commits)), "");
    commits.commit(8, 0, std::make_shared<const Bytes>(Bytes{1}));
    ASSERT_TRUE(commits.take(kNow));
    EXPECT_EQ(text(order.takeStates(commits)), "b2 ");
}

TEST(StateOrder, LS1AStateWaitsForPastCommits) {
    const CommitOrder commits(1'000);
    StateOrder order;
    order.statesFrom(1);
    order.state(1, 6, stateOf("a", 1));
    EXPECT_EQ(text(order.takeStates(commits)), "");
    EXPECT_EQ(text(order.takeStates(liveFrom(7))), "a1 ");
}

TEST(StateOrder, DD12ShowsOthersThanTheFirstAndRemovals) {
    StateOrder order;
    order.presence(1, presenceOf("ada", 1), kNow);
    order.presence(4, presenceOf("bo", 4), kNow);
    EXPECT_EQ(text(order.takePresences(kNow)), "");
    order.presencesFrom(3, {{presenceOf("ada", 1), presenceOf("cy", 2)}, {}}, kNow);
    EXPECT_EQ(text(order.takePresences(kNow)), "bo4 ");
    order.presence(4, presenceOf("bo", 4), kNow + 1s);  // repeated
    order.presence(5, presenceOf("ada", 5), kNow + 1s);
    EXPECT_EQ(text(order.takePresences(kNow + 1s)), "ada5 ");
    order.gone({"bo"});
    order.gone({"bo"});
    order.gone({"never here"});
    EXPECT_EQ(text(order.takePresences(kNow + 1s)), "-bo ");
}

TEST(StateOrder, PS2APresenceWithoutUpdatesIsRemoved) {
    StateOrder order;
    order.presencesFrom(3, {{presenceOf("ada", 1)}, {}}, kNow);
    order.presence(3, presenceOf("bo", 1), kNow);
    EXPECT_EQ(text(order.takePresences(kNow)), "bo1 ");
    EXPECT_EQ(order.deadline(), kNow + 3s);
    order.presence(3, presenceOf("bo", 1), kNow + 2s);
    EXPECT_EQ(text(order.takePresences(kNow + 2'999ms)), "");
    EXPECT_EQ(text(order.takePresences(kNow + 3s)), "-ada ");
    EXPECT_EQ(order.deadline(), kNow + 5s);
}

TEST(StateOrder, PS2AProcessThatHungRemovesNobody) {
    StateOrder order;
    order.presencesFrom(3, {{presenceOf("ada", 1)}, {}}, kNow);
    EXPECT_EQ(text(order.takePresences(kNow + 10s)), "");
    EXPECT_EQ(text(order.takePresences(kNow + 12s)), "");
    EXPECT_EQ(text(order.takePresences(kNow + 13s)), "-ada ");
}

TEST(StateOrder, KeptStatesAreBounded) {
    const CommitOrder commits = liveFrom(1);
    StateOrder order;
    order.statesFrom(1);
    order.presencesFrom(1, {}, kNow);
    for (std::uint64_t number = 1; number <= StateOrder::kMostLayers + 10; ++number)
        order.state(number, 0, stateOf("l" + std::to_string(number), 1));
    for (std::uint64_t number = 1; number <= StateOrder::kMostPeople + 10; ++number)
        order.presence(number, presenceOf("p" + std::to_string(number), 1), kNow);
    EXPECT_EQ(order.takeStates(commits).layers.size(), StateOrder::kMostLayers);
    EXPECT_EQ(order.takePresences(kNow).shown.size(), StateOrder::kMostPeople);
}
