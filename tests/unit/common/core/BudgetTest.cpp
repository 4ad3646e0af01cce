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

TEST(Budget, CountsWhatIsHeldWhateverTheOrder) {
    for (unsigned seed = 0; seed < 50; ++seed) {
        std::mt19937 random(seed);
        Budget<unsigned> budget{{.each = 100, .all = 300}};
        std::map<unsigned, std::size_t> held;
        for (int step = 0; step < 200; ++step) {
            const unsigned holder = random() % 5;
            const std::size_t amount = random() % 120;
            switch (random() % 4) {
                case 0:
                    budget.take(holder, amount), held[holder] += amount;
                    break;
                case 1:
                    budget.giveBack(holder, amount);
                    held[holder] -= std::min(held[holder], amount);
                    break;
                case 2:
                    budget.giveBackAll(holder), held[holder] = 0;
                    break;
                default:
                    budget.set(holder, amount), held[holder] = amount;
                    break;
            }
            std::size_t all = 0, most = 0;
            for (const auto& [one, bytes] : held) {
                ASSERT_EQ(budget.of(one), bytes);
                all += bytes;
                most = std::max(most, bytes);
            }
            ASSERT_EQ(budget.used(), all);
            const auto over = budget.givesWay(holder);
            ASSERT_EQ(over.has_value(), held[holder] > 100 || all > 300);
            if (over && *over != holder) {
                ASSERT_EQ(held[*over], most);
            }
        }
    }
}
