// Tests the counting and reporting of invalid DDS samples (DD13).
#include "transport/IgnoredSamples.h"

#include <gtest/gtest.h>

using namespace usdlive::server;

namespace {

IgnoredSamples::Participant participant(std::size_t number) {
    return {std::uint8_t(number), std::uint8_t(number >> 8)};
}

}  // namespace

TEST(IgnoredSamples, DD13CountsAllAndReportsTheFirstOfAParticipant) {
    IgnoredSamples samples;
    EXPECT_TRUE(samples.add(IgnoreReason::NotGreeted, participant(1)));
    EXPECT_FALSE(samples.add(IgnoreReason::NotGreeted, participant(1)));
    EXPECT_FALSE(samples.add(IgnoreReason::Malformed, participant(1)));
    EXPECT_TRUE(samples.add(IgnoreReason::Malformed, participant(2)));
    EXPECT_EQ(samples.counts(), (IgnoreCounts{2, 0, 0, 2, 0}));
    EXPECT_FALSE(samples.add(IgnoreReason::TooMany, participant(2), 1'000));
    EXPECT_EQ(samples.counts(), (IgnoreCounts{2, 0, 0, 2, 1'000}));
}

TEST(IgnoredSamples, KeepsABoundedNumberOfParticipants) {
    IgnoredSamples samples;
    for (std::size_t number = 0; number <= IgnoredSamples::kMostParticipants; ++number)
        EXPECT_TRUE(samples.add(IgnoreReason::OtherClient, participant(number)));
    EXPECT_TRUE(samples.add(IgnoreReason::OtherClient, participant(0)));  // forgotten meanwhile
    EXPECT_EQ(samples.counts()[std::size_t(IgnoreReason::OtherClient)],
              IgnoredSamples::kMostParticipants + 2);
}
