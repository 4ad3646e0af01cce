// Tests transactions and commits in parts (FR8).
#include <gtest/gtest.h>

#include "FakeHost.h"
#include "project/CommitContent.h"

namespace usdlive::server::projecttest {
namespace {

constexpr int kPrims = 60;

class ProjectParts : public ::testing::Test {
protected:
    void SetUp() override {
        world.options.wholeCommitBytes = 1'000;
        world.options.partBytes = 500;
        world.restart();
    }
    void join(SessionId session) {
        world.connect(session, world.hello(session));
        world.host.sent[session].clear();
    }
    static std::vector<Edit> paste() {
        std::vector<Edit> edits;
        for (int prim = 0; prim < kPrims; ++prim)
            edits.push_back(create("/P" + std::to_string(prim)));
        return edits;
    }
    std::vector<Bytes> parts(SessionId session, std::uint64_t sequence, std::vector<Edit> edits) {
        const Transaction transaction{{world.client(session), sequence}, 0, 0, std::move(edits)};
        std::vector<Bytes> parts;
        for (PartsAt at; !at.isEnd;) parts.push_back(encodePart(transaction, at, 500));
        return parts;
    }
    void submit(SessionId session, std::uint64_t sequence) {
        for (const Bytes& part : parts(session, sequence, paste()))
            world.project->received(session, part);
    }
    /// Takes a commit in parts that was sent to a session. Returns the number of parts.
    std::size_t takeCommit(SessionId session, Commit& commit) {
        CommitParts joining;
        for (std::size_t count = 1;; ++count) {
            const Bytes encoded = world.host.sent[session].at(0);
            auto joined = joining.add(world.nextFrame<CommitFrame>(session), encoded).value();
            if (!joined) continue;
            commit = std::move(joined->commit);
            EXPECT_EQ(joined->hashAfter, world.host.log.at(commit.revision - 1).hash);
            return count;
        }
    }

    World world;
    Commit commit;
};

TEST_F(ProjectParts, FR8PartsAreOneTransactionAndOneCommit) {
    join(1);
    join(2);
    const auto all = parts(1, 1, paste());
    ASSERT_GT(all.size(), 3u);
    for (const Bytes& part : all) {
        EXPECT_TRUE(world.host.loading.empty()) << "nothing is done before the last part";
        world.project->received(1, part);
    }
    world.load();
    ASSERT_EQ(world.host.appending.size(), 1u);
    EXPECT_TRUE(isInParts(*world.host.appending[0].frame));
    EXPECT_TRUE(world.silent(1)) << "not durable";
    world.store();
    for (const SessionId session : {1, 2}) {
        EXPECT_GT(takeCommit(session, commit), 3u);
        EXPECT_EQ(commit.edits.size(), std::size_t(kPrims));
        EXPECT_EQ(commit.revision, 1u);
    }
    EXPECT_EQ(decodeCommit(world.host.log[0]).value(), commit);
    // Later commits follow after it.
    world.submit(2, 1, {create("/C")});
    world.store();
    EXPECT_EQ(world.nextFrame<CommitFrame>(1).commit.revision, 2u);
    EXPECT_EQ(world.nextFrame<CommitFrame>(2).commit.revision, 2u);
}

TEST_F(ProjectParts, FR8ASlowReaderGetsThePartsAsItReads) {
    join(1);
    join(2);
    world.host.congestedSessions.insert(2);
    submit(1, 1);
    world.load();
    world.submit(1, 2, {create("/C")});
    world.store();
    takeCommit(1, commit);
    EXPECT_TRUE(world.silent(2));
    world.host.congestedSessions.clear();
    world.project->drained(2);
    takeCommit(2, commit);
    EXPECT_EQ(commit.edits.size(), std::size_t(kPrims));
    EXPECT_EQ(world.nextFrame<CommitFrame>(2).commit.revision, 2u);
}

TEST_F(ProjectParts, FR8AResumeAcrossItReadsFromTheStore) {
    world.options.recentCommitBytes = 0;
    world.restart();
    join(1);
    submit(1, 1);
    world.load();
    world.submit(1, 2, {create("/C")});
    world.store();
    Hello hello = world.hello(3);
    hello.resume = Hello::Resume{world.epoch, 0, Hash{}};
    world.connect(3, hello);
    EXPECT_TRUE(world.nextControl<Welcome>(3).resumed);
    while (!world.host.reading.empty()) world.answerRead();
    EXPECT_GT(takeCommit(3, commit), 3u);
    while (!world.host.reading.empty()) world.answerRead();
    EXPECT_EQ(world.nextFrame<CommitFrame>(3).commit.revision, 2u);
}

TEST_F(ProjectParts, SE22TheSessionWithTheMostUnfinishedPartsGivesWay) {
    const auto all = parts(1, 1, paste());
    std::size_t bytes = 0;
    for (const Bytes& part : all) bytes += part.size();
    world.options.maxTransactionBytes = bytes;  // 3 1/4 of them for all sessions together
    world.restart();
    for (const SessionId session : {1, 2, 3, 4, 5}) join(session);
    const auto begin = [&](SessionId session, std::size_t count) {
        const auto its = parts(session, 1, paste());
        for (std::size_t part = 0; part < count; ++part)
            world.project->received(session, its.at(part));
    };
    begin(1, 2);
    for (const SessionId session : {2, 3, 4, 5}) begin(session, all.size() - 1);
    EXPECT_FALSE(world.host.closed.contains(1)) << "it has the least";
    ASSERT_EQ(world.host.closed.size(), 1u);
    const SessionId gone = *world.host.closed.begin();
    EXPECT_EQ(world.nextControl<ErrorMessage>(gone).code, "transactionTooLarge");
}

TEST_F(ProjectParts, SE22WhatWasOrderedOrRefusedTakesNothing) {
    world.options.maxTransactionBytes = 4'000;
    world.restart();
    join(1);
    for (std::uint64_t sequence = 1; sequence <= 20; ++sequence) {
        submit(1, sequence);
        if (sequence == 1) world.load();
        world.store();
    }
    EXPECT_TRUE(world.host.closed.empty());
}

TEST_F(ProjectParts, FR8ATooLargeTransactionIsRefusedOnceWithTheLimit) {
    world.options.maxTransactionBytes = 2'000;
    world.restart();
    join(1);
    submit(1, 1);
    const auto refusal = world.nextFrame<RefusalFrame>(1);
    EXPECT_EQ(refusal.sequence, 1u);
    EXPECT_EQ(refusal.error.code, ErrorCode::TransactionTooLarge);
    EXPECT_NE(refusal.error.message.find("--max-transaction-mib"), std::string::npos);
    EXPECT_TRUE(world.silent(1));
    EXPECT_FALSE(world.host.closed.contains(1));
    world.submit(1, 2, {create("/C")});
    world.load();
    EXPECT_EQ(world.host.appending.size(), 1u) << "the session continues";
}

TEST_F(ProjectParts, FR8ACommitThatIsLargerThanItsTransactionIsUndone) {
    world.options.maxTransactionBytes = 6'000;
    world.restart();
    join(1);
    world.submit(1, 1, {create("/" + std::string(1'000, 'n'))});
    world.load();
    std::vector<Edit> edits;
    for (int number = 0; number < 5; ++number)
        edits.push_back(inCreated(1, 0, "/C" + std::to_string(number), CreateSpec{}));
    world.submit(1, 2, edits);
    world.store();
    EXPECT_EQ(world.nextFrame<CommitFrame>(1).commit.revision, 1u);
    EXPECT_EQ(world.nextFrame<RefusalFrame>(1).error.code, ErrorCode::TransactionTooLarge);
    EXPECT_EQ(world.project->layer({"a.usda"})->children("/", ChildList::Prims).size(), 3u);
}

TEST_F(ProjectParts, FR8ANewFirstPartReplacesAnUnfinishedTransaction) {
    join(1);
    const auto first = parts(1, 1, paste());
    world.project->received(1, first[0]);
    world.project->received(1, first[1]);
    submit(1, 2);
    world.load();
    world.store();
    takeCommit(1, commit);
    EXPECT_EQ(commit.id.sequence, 2u);
    world.project->received(1, first[2]);
    EXPECT_EQ(world.nextControl<ErrorMessage>(1).code, "malformedFrame");
    EXPECT_TRUE(world.host.closed.contains(1));
}

TEST_F(ProjectParts, FR8PartsOfAnEndedConnectionAreDropped) {
    join(1);
    const auto all = parts(1, 1, paste());
    world.project->received(1, all[0]);
    world.project->disconnected(1);
    join(1);
    submit(1, 1);
    world.load();
    world.store();
    takeCommit(1, commit);
    EXPECT_EQ(commit.edits.size(), std::size_t(kPrims));
}

TEST_F(ProjectParts, FR8OnlyOneAuthorsPartsAreTaken) {
    join(1);
    for (const Bytes& part : parts(2, 1, paste())) world.project->received(1, part);
    EXPECT_EQ(world.nextControl<ErrorMessage>(1).code, "malformedFrame");
    EXPECT_TRUE(world.host.appending.empty());
}

TEST_F(ProjectParts, FR8TheLogHasCommitsInParts) {
    join(1);
    submit(1, 1);
    world.load();
    world.store();
    takeCommit(1, commit);
    world.receive(1, ControlMessage(RequestLog{7, 1, 0}));
    EXPECT_EQ(world.nextControl<LogBegin>(1).request, 7u);
    while (!world.host.reading.empty()) world.answerRead();
    takeCommit(1, commit);
    EXPECT_EQ(commit.edits.size(), std::size_t(kPrims));
    EXPECT_EQ(world.nextControl<LogEnd>(1).request, 7u);
}

}  // namespace
}  // namespace usdlive::server::projecttest
