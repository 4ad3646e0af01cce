// Tests who gives way when a resource is short.
#include "usdlive/common/core/Budget.h"

#include <gtest/gtest.h>

#include <random>
#include <string>

using namespace usdlive;

TEST(Budget, AHolderBeyondItsOwnLimitGivesWay) {
    Budget<std::string> budget{{.each = 10, .all = 25}};
    budget.take("ada", 10);
    EXPECT_EQ(budget.givesWay("ada"), std::nullopt);
    budget.take("ada", 1);
    EXPECT_EQ(budget.givesWay("ada"), "ada");
    budget.giveBack("ada", 1);
    EXPECT_EQ(budget.givesWay("ada"), std::nullopt);
}

TEST(Budget, TheHolderWithTheMostGivesWayForOthers) {
    Budget<std::string> budget{{.each = 10, .all = 25}};
    budget.take("ada", 9);
    budget.take("bob", 10);
    budget.take("eve", 7);
    EXPECT_EQ(budget.givesWay("eve"), "bob") << "not who came last";
    budget.giveBackAll("bob");
    EXPECT_EQ(budget.givesWay("eve"), std::nullopt);
    EXPECT_EQ(budget.used(), 16u);
}

TEST(Budget, ManyHoldersOfAGroupTakeNoMoreThanItsShare) {
    Budget<int> budget{{.each = 10, .group = 15, .all = 40}};
    budget.take(1, 6, "ada");
    budget.take(2, 8, "ada");
    EXPECT_EQ(budget.givesWay(2), std::nullopt);
    budget.take(3, 2, "ada");
    EXPECT_EQ(budget.ofGroup("ada"), 16u);
    EXPECT_EQ(budget.givesWay(3), 2) << "the one of the group with the most";
    budget.giveBackAll(2);
    EXPECT_EQ(budget.givesWay(3), std::nullopt);
    EXPECT_EQ(budget.ofGroup("ada"), 8u);
}

TEST(Budget, HoldersWithoutAGroupShareNoLimit) {
    Budget<int> budget{{.each = 10, .group = 15, .all = 40}};
    for (const int holder : {1, 2, 3}) budget.take(holder, 10);
    EXPECT_EQ(budget.givesWay(3), std::nullopt);
}

TEST(Budget, TheGroupWithTheMostGivesWayForOthers) {
    Budget<int> budget{{.each = 10, .all = 25}};
    for (const int holder : {1, 2, 3, 4}) budget.take(holder, 4, "ada");
    budget.take(5, 9, "bob");
    EXPECT_EQ(budget.givesWay(5), std::nullopt);
    budget.take(6, 1, "eve");
    ASSERT_TRUE(budget.givesWay(6));
    EXPECT_LE(*budget.givesWay(6), 4)
        << "bob's session has more than each of ada's, but ada has most";
}

TEST(Budget, CountsWhatIsHeldWhateverTheOrder) {
    for (unsigned seed = 0; seed < 50; ++seed) {
        std::mt19937 random(seed);
        Budget<unsigned> budget{{.each = 100, .all = 300}};
        const std::string group = seed % 2 ? "ada" : "";
        std::map<unsigned, std::size_t> held;
        for (int step = 0; step < 200; ++step) {
            const unsigned holder = random() % 5;
            const std::size_t amount = random() % 120;
            switch (random() % 4) {
                case 0:
                    budget.take(holder, amount, group), held[holder] += amount;
                    break;
                case 1:
                    budget.giveBack(holder, amount);
                    held[holder] -= std::min(held[holder], amount);
                    break;
                case 2:
                    budget.giveBackAll(holder), held[holder] = 0;
                    break;
                default:
                    budget.set(holder, amount, group), held[holder] = amount;
                    break;
            }
            std::size_t all = 0, most = 0;
            for (const auto& [one, bytes] : held) {
                ASSERT_EQ(budget.of(one), bytes);
                all += bytes;
                most = std::max(most, bytes);
            }
            ASSERT_EQ(budget.used(), all);
            ASSERT_EQ(budget.ofGroup(group), all);
            const auto over = budget.givesWay(holder);
            ASSERT_EQ(over.has_value(), held[holder] > 100 || all > 300);
            if (over && *over != holder) {
                ASSERT_EQ(held[*over], most);
            }
        }
    }
}
