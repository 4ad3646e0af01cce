// Tests the colours of users (PS3).
#include "usdlive/common/core/UserColour.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <set>
#include <string>

namespace usdlive {
namespace {

TEST(UserColour, PS3IsTheSameForAUserAndDiffersForOthers) {
    EXPECT_EQ(userColour({"ada"}), userColour({"ada"}));
    std::set<std::array<float, 3>> colours;
    for (int number = 0; number < 100; ++number) {
        const auto colour = userColour({"user" + std::to_string(number)});
        colours.insert(colour);
        const auto [least, most] = std::minmax_element(colour.begin(), colour.end());
        EXPECT_NEAR(*most, 0.95f, 1e-5);
        EXPECT_NEAR(*least, 0.95f * 0.35f, 1e-5);
    }
    EXPECT_GT(colours.size(), 95u);
}

// The values were computed with Python's colorsys from the first 16 bits of the name's SHA-256.
TEST(UserColour, PS3EqualsTheDocumentedColours) {
    const auto ada = userColour({"ada"});
    EXPECT_NEAR(ada[0], 0.95000, 1e-4);
    EXPECT_NEAR(ada[1], 0.33250, 1e-4);
    EXPECT_NEAR(ada[2], 0.36246, 1e-4);
}

}  // namespace
}  // namespace usdlive
