// Tests the limit of log lines for each key.
#include "app/LogLimit.h"

#include <gtest/gtest.h>

using namespace usdlive::server;

TEST(LogLimit, SaysHowManyLinesItLeftOut) {
    LogLimit limit;
    for (std::uint64_t i = 0; i < LogLimit::kLines; ++i) EXPECT_EQ(limit.take("ada", 5), 0u);
    for (int i = 0; i < 7; ++i) EXPECT_FALSE(limit.take("ada", 6));
    EXPECT_EQ(limit.take("bob", 6), 0u) << "each key has its own limit";
    EXPECT_EQ(limit.take("ada", 5 + LogLimit::kWindowMs), 7u);
    EXPECT_EQ(limit.take("ada", 6 + LogLimit::kWindowMs), 0u);
}

TEST(LogLimit, ManyKeysShareTheRest) {
    LogLimit limit;
    std::uint64_t logged = 0;
    for (int i = 0; i < 100'000; ++i) logged += limit.take("user" + std::to_string(i), 0) ? 1 : 0;
    EXPECT_LE(logged, LogLimit::kMostKeys + LogLimit::kLines);
    EXPECT_TRUE(limit.take("later", LogLimit::kWindowMs)) << "old windows make room";
}
