// Tests the commits that are kept to be sent again (DD7).
#include "transport/SentCommits.h"

#include <gtest/gtest.h>

using namespace usdlive;
using server::SentCommits;

namespace {

SentCommits::Sent sent(std::size_t bytes) { return {std::make_shared<const Bytes>(bytes), {}}; }

}  // namespace

TEST(SentCommits, DD7KeepsTheLatest) {
    SentCommits commits;
    for (Revision revision = 5; revision < 5 + 2 * SentCommits::kCommits; ++revision)
        commits.add(revision, sent(10));
    EXPECT_EQ(commits.newest(), 4 + 2 * SentCommits::kCommits);
    EXPECT_TRUE(commits.find(commits.newest()));
    EXPECT_TRUE(commits.find(commits.newest() - SentCommits::kCommits + 1));
    EXPECT_FALSE(commits.find(commits.newest() - SentCommits::kCommits));
    EXPECT_FALSE(commits.find(commits.newest() + 1));
}

TEST(SentCommits, DD7BoundsBytes) {
    SentCommits commits;
    for (Revision revision = 1; revision <= 5; ++revision)
        commits.add(revision, sent(SentCommits::kBytes / 2));
    EXPECT_TRUE(commits.find(5) && commits.find(4));
    EXPECT_FALSE(commits.find(3));
}

TEST(SentCommits, ForgetsCommitsBeforeAGap) {
    SentCommits commits;
    commits.add(1, sent(1));
    commits.add(7, {nullptr, {{3, 40}, {4, 50}}});
    EXPECT_FALSE(commits.find(1));
    ASSERT_TRUE(commits.find(7));
    EXPECT_EQ(commits.find(7)->positionOf(4), 50u);
    EXPECT_EQ(commits.find(7)->positionOf(5), 0u);
}
