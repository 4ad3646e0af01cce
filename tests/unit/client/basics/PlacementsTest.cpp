// Tests the moves that turn one order of children into another.
#include "basics/Placements.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>

using Names = std::vector<std::string>;
using usdlive::client::placements;

namespace {

Names applied(Names list, const std::vector<std::pair<std::string, std::string>>& moves) {
    for (const auto& [name, before] : moves) {
        list.erase(std::find(list.begin(), list.end(), name));
        list.insert(std::find(list.begin(), list.end(), before), name);
    }
    return list;
}

}  // namespace

TEST(Placements, OneMovedChildIsOneMove) {
    const Names from{"a", "b", "c", "d"};
    EXPECT_TRUE(placements(from, from).empty());
    EXPECT_TRUE(placements({}, {}).empty());
    EXPECT_EQ(placements(from, {"d", "a", "b", "c"}).size(), 1u);
    EXPECT_EQ(placements(from, {"b", "c", "d", "a"}),
              (std::vector<std::pair<std::string, std::string>>{{"a", ""}}));
    EXPECT_EQ(placements(from, {"d", "c", "b", "a"}).size(), 3u);
}

TEST(Placements, TurnsAnyOrderIntoAnyOther) {
    for (unsigned seed = 0; seed < 200; ++seed) {
        SCOPED_TRACE(seed);
        std::mt19937 random(seed);
        Names from;
        for (unsigned i = 0; i < random() % 12; ++i) from.push_back(std::to_string(i));
        Names to = from;
        std::shuffle(to.begin(), to.end(), random);
        EXPECT_EQ(applied(from, placements(from, to)), to);
    }
}
