// Tests what is kept of the values that were used last.
#include "app/LastUsed.h"

#include <gtest/gtest.h>

#include <string>

namespace usdlive::server {
namespace {

TEST(LastUsed, DropsWhatWasNotUsedForTheLongestTime) {
    LastUsed<std::string, int> values(10);
    values.add("a", 1, 4);
    values.add("b", 2, 4);
    ASSERT_TRUE(values.find("a"));
    values.add("c", 3, 4);
    EXPECT_FALSE(values.find("b"));
    EXPECT_EQ(*values.find("a"), 1);
    EXPECT_EQ(*values.find("c"), 3);
}

TEST(LastUsed, KeepsNothingThatIsLargerThanAll) {
    LastUsed<std::string, int> values(10);
    values.add("a", 1, 4);
    values.add("b", 2, 11);
    EXPECT_FALSE(values.find("a"));
    EXPECT_FALSE(values.find("b"));
    values.add("c", 3, 10);
    EXPECT_EQ(*values.find("c"), 3);
}

}  // namespace
}  // namespace usdlive::server
