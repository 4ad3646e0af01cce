// Tests LostEvents: reports of lost work.
#include "work/LostEvents.h"

#include <gtest/gtest.h>

using namespace usdlive;
using client::LostEvents;
namespace event = client::event;

namespace {

using client::LostWork;

event::Lost lost(const std::string& path, std::size_t index) {
    LostWork work;
    work.reason = {ErrorCode::Locked, "a.usda is locked by ada"};
    work.edits.push_back({LayerId{"a.usda"}, path, SetField{"default", {}, doubleValue(1), {}}});
    return {std::move(work), index};
}

}  // namespace

TEST(LostEvents, ReportsTheFirstAtOnceAndTheFollowingTogether) {
    LostEvents events;
    EXPECT_TRUE(events.add(lost("/A.x", 0), 0));
    for (std::size_t i = 1; i <= 5; ++i) EXPECT_FALSE(events.add(lost("/A.x", i), 100));
    EXPECT_TRUE(events.add(lost("/B.x", 6), 100)) << "another register";
    EXPECT_TRUE(events.due(LostEvents::kTogetherMs - 1).empty());
    const auto due = events.due(LostEvents::kTogetherMs);
    ASSERT_EQ(due.size(), 1u);
    EXPECT_EQ(due[0].index, 5u);
    EXPECT_EQ(due[0].count, 5u);
}

TEST(LostEvents, PendingEventsAreReportedOnLeaving) {
    LostEvents events;
    for (std::size_t i = 0; i < 3; ++i) {
        (void)events.add(lost("/A.x", 2 * i), 0);
        (void)events.add(lost("/B.x", 2 * i + 1), 0);
    }
    const auto waiting = events.waiting();
    ASSERT_EQ(waiting.size(), 2u);
    EXPECT_EQ(waiting[0].index, 4u);
    EXPECT_EQ(waiting[1].index, 5u);
    EXPECT_EQ(waiting[0].count, 2u);
    EXPECT_TRUE(events.waiting().empty()) << "once";
    EXPECT_TRUE(events.due(10 * LostEvents::kTogetherMs).empty());
}

TEST(LostEvents, AnIdleFrameAllocatesNothing) {
    LostEvents events;
    (void)events.add(lost("/A.x", 0), 0);
    (void)events.add(lost("/A.x", 1), 0);
    EXPECT_EQ(events.due(1).capacity(), 0u);
}
