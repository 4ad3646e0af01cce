// Tests the marks of a session's stream (DD5, DD6).
#include "transport/ReplyMarks.h"

#include <gtest/gtest.h>

using namespace usdlive;
using dds::StreamMark;
using server::ReplyMarks;

TEST(ReplyMarks, DD5ACommitWaitsForWhatWasSentBeforeIt) {
    ReplyMarks marks;
    EXPECT_EQ(marks.frames(40), StreamMark{});
    EXPECT_EQ(marks.commitSent(5), (StreamMark{0, false, 5})) << "the first one starts them";
    EXPECT_EQ(marks.unmarked(), 40u);
    EXPECT_EQ(marks.commitSent(6), std::nullopt);
    EXPECT_EQ(marks.unmarked(), std::nullopt) << "commit 5 waits, and 6 follows it";
    EXPECT_EQ(marks.frames(60), StreamMark{6});
    EXPECT_EQ(marks.commitSent(7), std::nullopt);
    EXPECT_EQ(marks.unmarked(), 100u);
}

TEST(ReplyMarks, DD5ACommitWaitsForWhatWasSentBeforeAHold) {
    ReplyMarks marks;
    (void)marks.commitSent(5);
    EXPECT_EQ(marks.frames(40), StreamMark{5});
    EXPECT_EQ(marks.hold(), (StreamMark{5, true}));
    EXPECT_EQ(marks.unmarked(), 40u) << "the client may receive commit 6 before the hold";
    EXPECT_EQ(marks.release(7), (StreamMark{5, false, 7}));
    EXPECT_EQ(marks.release(7), std::nullopt);
}

TEST(ReplyMarks, DD6ALargeCommitComesInTheStreamAndStartsTheNextOnes) {
    ReplyMarks marks;
    (void)marks.commitSent(5);
    EXPECT_EQ(marks.commit(100, 6), (StreamMark{5, false, 7}));
    EXPECT_EQ(marks.lastCommit(), 6u);
    EXPECT_EQ(marks.commitSent(7), std::nullopt);
    EXPECT_EQ(marks.unmarked(), 100u);
}
