// Tests the counting and reporting of invalid DDS samples (DD13).
#include "usdlive/server/transport/OddSamples.h"

#include <gtest/gtest.h>

using namespace usdlive::server;

namespace {

OddSamples::Participant participant(std::size_t number) {
    return {std::uint8_t(number), std::uint8_t(number >> 8)};
}

}  // namespace

TEST(OddSamples, DD13CountsAllAndReportsTheFirstOfAParticipant) {
    OddSamples odd;
    EXPECT_TRUE(odd.add(Oddity::NotGreeted, participant(1)));
    EXPECT_FALSE(odd.add(Oddity::NotGreeted, participant(1)));
    EXPECT_FALSE(odd.add(Oddity::Malformed, participant(1)));
    EXPECT_TRUE(odd.add(Oddity::Malformed, participant(2)));
    EXPECT_EQ(odd.counts(), (OddityCounts{2, 0, 0, 2}));
}

TEST(OddSamples, KeepsABoundedNumberOfParticipants) {
    OddSamples odd;
    for (std::size_t number = 0; number <= OddSamples::kMostParticipants; ++number)
        EXPECT_TRUE(odd.add(Oddity::OtherClient, participant(number)));
    EXPECT_TRUE(odd.add(Oddity::OtherClient, participant(0)));  // forgotten meanwhile
    EXPECT_EQ(odd.counts()[std::size_t(Oddity::OtherClient)], OddSamples::kMostParticipants + 2);
}
