// Tests that a session that falls behind gets the past commits conflated (FR6, CF1).
#include <gtest/gtest.h>

#include "FakeHost.h"

namespace usdlive::server::projecttest {
namespace {

class SlowReader : public ::testing::Test {
protected:
    SlowReader() {
        world.options.maxBehind = 1'000;
        world.start();
        for (const SessionId session : {1, 2}) {
            Hello hello = world.hello(session);
            hello.features = {"conflation"};
            world.connect(session, hello);
            world.receive(session, ControlMessage(OpenLayer{1, {"a.usda"}, 0}));
        }
        world.load();
        world.host.sent.clear();
    }
    void write(double value, SessionId session = 1) {
        world.submit(session, ++sequence, {set("/A.x", value)}, world.project->durableRevision());
        world.store();
    }
    void read() {
        world.host.congestedSessions.clear();
        world.project->drained(2);
    }

    World world;
    std::uint64_t sequence = 0;
};

TEST_F(SlowReader, CF1GetsOneCommitForMany) {
    write(1);
    EXPECT_EQ(world.nextFrame<CommitFrame>(2).commit.conflated, 0u);
    const Hash before = world.lastHash;
    world.host.congestedSessions = {2};
    for (int value = 2; value <= 50; ++value) write(value);
    EXPECT_TRUE(world.silent(2)) << "nothing queues up";
    read();
    const auto frame = world.nextFrame<CommitFrame>(2);
    EXPECT_EQ(frame.commit.revision, 50u);
    EXPECT_EQ(frame.commit.conflated, 48u);
    EXPECT_EQ(frame.commit.previous, before);
    EXPECT_EQ(frame.hashAfter, world.host.log.back().hash);
    EXPECT_EQ(frame.commit.edits, std::vector{set("/A.x", 50)});
    EXPECT_TRUE(world.silent(2));
    write(51);
    EXPECT_EQ(world.nextFrame<CommitFrame>(2).commit.revision, 51u) << "it is live again";
    EXPECT_EQ(world.host.sent[1].size(), 51u) << "other sessions are not affected";
}

// A client that wants to learn the results of its own work begins at the revision of the welcome.
TEST_F(SlowReader, CF1EndsWhereTheClientBegins) {
    for (int value = 1; value <= 5; ++value) write(value);
    Hello hello = world.hello(3);
    hello.features = {"conflation"};
    hello.resume = {1, 1, world.host.log[0].hash};
    world.host.congestedSessions = {3};
    world.connect(3, hello);
    EXPECT_EQ(world.nextControl<Welcome>(3).revision, 5u);
    for (int value = 6; value <= 9; ++value) write(value);
    world.host.congestedSessions.clear();
    world.project->drained(3);
    std::vector<std::pair<Revision, Revision>> got;
    while (!world.silent(3)) {
        const Commit commit = world.nextFrame<CommitFrame>(3).commit;
        got.emplace_back(commit.revision, commit.conflated);
    }
    EXPECT_EQ(got, (std::vector<std::pair<Revision, Revision>>{{5, 3}, {9, 3}}));
}

TEST_F(SlowReader, CF1ItsOwnCommitsAndGesturesStayWhole) {
    world.host.congestedSessions = {2};
    write(1);
    write(2);
    world.submit(2, 1, {set("/A.x", 3)});
    world.store();
    write(4);
    world.submit(1, ++sequence, {set("/A.x", 5)}, 0, 7);
    world.store();
    write(6);
    write(7);
    read();
    std::vector<std::pair<Revision, Revision>> got;
    while (!world.silent(2)) {
        const Commit commit = world.nextFrame<CommitFrame>(2).commit;
        got.emplace_back(commit.revision, commit.conflated);
    }
    EXPECT_EQ(got,
              (std::vector<std::pair<Revision, Revision>>{{2, 1}, {3, 0}, {4, 0}, {5, 0}, {7, 1}}));
}

TEST_F(SlowReader, CF1EndsWhereALayerWasSent) {
    world.host.congestedSessions = {2};
    write(1);
    write(2);
    world.receive(2, ControlMessage(CloseLayer{{"a.usda"}}));
    world.receive(2, ControlMessage(OpenLayer{2, {"a.usda"}, 0}));
    EXPECT_EQ(world.nextControl<LayerOpened>(2).revision, 2u);
    write(3);
    write(4);
    read();
    EXPECT_EQ(world.nextFrame<CommitFrame>(2).commit.revision, 2u);
    const Commit rest = world.nextFrame<CommitFrame>(2).commit;
    EXPECT_EQ(rest.revision, 4u);
    EXPECT_EQ(rest.conflated, 1u);
}

// The session may have received some of the commits before it learned that it is not live.
TEST_F(SlowReader, CF1NoConflationWhileTheSessionMayHaveLaterCommits) {
    world.host.sendsToAll = true;
    write(1);
    world.host.sent.clear();
    world.host.congestedSessions = {2};
    world.receive(2, ControlMessage(RequestLog{5, 1, 1}));
    for (int value = 2; value <= 5; ++value) write(value);
    read();
    EXPECT_EQ(world.nextControl<LogBegin>(2).request, 5u);
    EXPECT_EQ(world.nextFrame<CommitFrame>(2).commit.revision, 1u);
    EXPECT_EQ(world.nextControl<LogEnd>(2).request, 5u);
    for (Revision revision = 2; revision <= 5; ++revision) {
        const Commit commit = world.nextFrame<CommitFrame>(2).commit;
        EXPECT_EQ(commit.revision, revision);
        EXPECT_EQ(commit.conflated, 0u);
    }
    world.host.congestedSessions = {2};
    write(6);
    write(7);
    read();
    EXPECT_EQ(world.nextFrame<CommitFrame>(2).commit.conflated, 1u)
        << "the session was live since then";
}

TEST_F(SlowReader, CF1ASessionWithoutTheFeatureGetsAllCommits) {
    world.join(3);
    world.host.congestedSessions = {3};
    for (int value = 1; value <= 10; ++value) write(value);
    EXPECT_TRUE(world.silent(3));
    world.host.congestedSessions.clear();
    world.project->drained(3);
    EXPECT_EQ(world.host.sent[3].size(), 10u);
}

TEST_F(SlowReader, FR6ASessionTooFarBehindIsCut) {
    world.host.congestedSessions = {2};
    for (int value = 0; value <= 1'001; ++value) write(value);
    read();
    EXPECT_EQ(world.nextControl<ErrorMessage>(2).code, "slowReader");
    EXPECT_TRUE(world.host.closed.contains(2));
}

// Reads the same layer commit by commit and conflated, from the store and from memory.
TEST_F(SlowReader, CF1ComesFromTheStoreToo) {
    world.options.recentCommitBytes = 1'000;
    world.restart();
    for (const SessionId session : {1, 2}) {
        Hello hello = world.hello(session);
        hello.features = {"conflation"};
        world.connect(session, hello);
    }
    world.host.sent.clear();
    world.host.loading.clear();
    world.receive(1, ControlMessage(OpenLayer{1, {"a.usda"}, 0}));
    world.load();
    world.host.congestedSessions = {2};
    sequence = 100;
    for (int value = 0; value < 100; ++value) write(value);
    read();
    world.answerRead();
    const Commit commit = world.nextFrame<CommitFrame>(2).commit;
    EXPECT_EQ(commit.conflated, 99u);
    EXPECT_EQ(commit.edits, std::vector{set("/A.x", 99)});
}

}  // namespace
}  // namespace usdlive::server::projecttest
