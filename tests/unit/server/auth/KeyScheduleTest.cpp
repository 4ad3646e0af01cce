// Tests when an issuer is asked for its keys (AC24).
#include "auth/KeySchedule.h"

#include <gtest/gtest.h>

namespace usdlive::server {
namespace {

using namespace std::chrono_literals;

TEST(KeySchedule, AC24KeysAreReadEachHourAndLastADay) {
    KeySchedule schedule;
    KeySchedule::Time now{};
    EXPECT_FALSE(schedule.hasKeys());
    auto next = schedule.read(now);
    EXPECT_TRUE(next.isChange);
    EXPECT_EQ(next.pause, KeySchedule::kRefresh);
    EXPECT_FALSE(schedule.read(now += 1h).isChange);
    // The issuer is down. It is asked again soon, then each minute.
    next = schedule.failed(now += 1h);
    EXPECT_TRUE(next.isChange);
    EXPECT_EQ(next.pause, 2s);
    EXPECT_EQ(schedule.failed(now += 2s).pause, 4s);
    for (int times = 0; times < 10; ++times) next = schedule.failed(now += 1min);
    EXPECT_EQ(next.pause, 60s);
    EXPECT_FALSE(next.isChange || next.endsKeys);
    EXPECT_TRUE(schedule.hasKeys());
    now += 23h;
    next = schedule.failed(now);
    EXPECT_TRUE(next.endsKeys);
    EXPECT_FALSE(schedule.hasKeys());
    EXPECT_FALSE(schedule.failed(now += 1min).endsKeys);
    next = schedule.read(now += 1min);
    EXPECT_TRUE(next.isChange && schedule.hasKeys());
    EXPECT_EQ(schedule.failed(now).pause, 2s);
}

TEST(KeySchedule, AC24KeysLastADayAndNotLess) {
    KeySchedule schedule;
    KeySchedule::Time now{};
    (void)schedule.read(now);
    EXPECT_FALSE(schedule.failed(now + 24h - 1s).endsKeys);
    EXPECT_TRUE(schedule.failed(now + 24h).endsKeys);
}

TEST(KeySchedule, AC24UnknownKeysAreAReasonOnceInHalfAMinute) {
    KeySchedule schedule;
    KeySchedule::Time now{};
    (void)schedule.read(now);
    EXPECT_TRUE(schedule.mayLook(now));
    schedule.looked(now);
    EXPECT_FALSE(schedule.mayLook(now + 29s));
    EXPECT_TRUE(schedule.mayLook(now + 30s));
}

}  // namespace
}  // namespace usdlive::server
