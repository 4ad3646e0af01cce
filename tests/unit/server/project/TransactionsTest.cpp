// Tests transactions in a project: order, execution, refusals and a failing store.
#include <gtest/gtest.h>

#include <random>

#include "FakeHost.h"

namespace usdlive::server::projecttest {
namespace {

class ProjectTransactions : public ::testing::Test {
protected:
    void SetUp() override {
        world.join(1);
        world.join(2);
        world.receive(1, ControlMessage(OpenLayer{1, {"a.usda"}, 0}));
        world.load();
        world.host.sent.clear();
    }
    RefusalFrame expectRefusal(SessionId session, std::uint64_t sequence, ErrorCode code) {
        const auto refusal = world.nextFrame<RefusalFrame>(session);
        EXPECT_EQ(refusal.sequence, sequence);
        EXPECT_EQ(refusal.error.code, code) << refusal.error.message;
        return refusal;
    }

    World world;
};

TEST_F(ProjectTransactions, ACommitIsSentToAllOnceDurable) {
    world.submit(1, 1, {create("/C"), set("/A.x", 2)});
    EXPECT_TRUE(world.silent(1));
    EXPECT_TRUE(world.silent(2));
    world.store();
    const auto own = world.nextFrame<CommitFrame>(1);
    EXPECT_EQ(own, world.nextFrame<CommitFrame>(2));
    EXPECT_EQ(own.commit.revision, 1u);
    EXPECT_EQ(own.commit.epoch, 1u);
    EXPECT_EQ(own.commit.id, (TransactionId{world.client(1), 1}));
    EXPECT_EQ(own.commit.user, UserName{"user1"});
    EXPECT_EQ(own.commit.edits.size(), 2u);
    EXPECT_EQ(world.project->durableRevision(), 1u);
    EXPECT_EQ(world.project->counters().commits, 1u);
    EXPECT_EQ(world.project->counters().delivered, 2u);
    EXPECT_EQ(world.records[0].layers, std::set<LayerId>{{"a.usda"}});
}

TEST_F(ProjectTransactions, TheChainOfHashesContinues) {
    Hash hash;
    for (std::uint64_t number = 1; number <= 3; ++number) {
        world.submit(1, number, {set("/A.x", double(number))}, number - 1);
        world.store();
        EXPECT_EQ(world.nextFrame<CommitFrame>(2).commit.previous, hash);
        hash = world.lastHash;
        EXPECT_EQ(world.records.back().hash, hash);
    }
}

TEST_F(ProjectTransactions, M3AnEditFindsTheSpecThatWasMovedMeanwhile) {
    world.submit(1, 1, {move("/A", "/B", "C")});
    world.submit(2, 1, {set("/A.x", 7)});
    world.store();
    world.next(2);
    EXPECT_EQ(world.nextFrame<CommitFrame>(2).commit.edits[0].address.path, "/B/C.x");
    EXPECT_TRUE(world.project->layer({"a.usda"})->field("/B/C.x", "default"));
    ASSERT_EQ(world.records[0].namespaceChanges.size(), 1u);
    EXPECT_EQ(world.records[0].namespaceChanges[0], (NamespaceChange{1, {"a.usda"}, "/A", "/B/C"}));
}

TEST_F(ProjectTransactions, M3AlsoAfterARestart) {
    world.submit(1, 1, {move("/A", "/B", "C")});
    world.store();
    const LayerDoc doc = *world.project->layer({"a.usda"});
    world.restart();
    world.join(2);
    world.submit(2, 1, {set("/A.x", 7)});
    world.project->layerLoaded({"a.usda"}, LoadedLayer{doc});
    world.store();
    EXPECT_EQ(world.nextFrame<CommitFrame>(2).commit.edits.at(0).address.path, "/B/C.x");
}

TEST_F(ProjectTransactions, M3ACreationIsLookedUpInTheStoreAfterARestart) {
    world.submit(1, 1, {move("/B", "/", "Q"), create("/C")});
    world.store();
    world.submit(2, 1, {move("/C", "/A", "D")}, 1);
    world.store();
    const LayerDoc doc = *world.project->layer({"a.usda"});
    world.restart();
    world.join(1);
    world.submit(1, 2, {inCreated(1, 1, "/E", CreateSpec{SpecKind::Prim})});
    world.project->layerLoaded({"a.usda"}, LoadedLayer{doc});
    EXPECT_TRUE(world.host.appending.empty());
    world.answerRead();
    world.store();
    EXPECT_EQ(world.nextFrame<CommitFrame>(1).commit.edits.at(0).address.path, "/A/D/E");
}

TEST_F(ProjectTransactions, M4AnEditOfADeletedSpecIsDroppedAndReported) {
    world.submit(1, 1, {erase("/A")});
    world.submit(2, 1, {set("/A.x", 7), create("/C")});
    world.store();
    world.next(2);
    const auto commit = world.nextFrame<CommitFrame>(2).commit;
    EXPECT_EQ(commit.edits.size(), 1u);
    ASSERT_EQ(commit.dropped.size(), 1u);
    EXPECT_EQ(commit.dropped[0], (DroppedEdit{0, ErrorCode::SpecDeleted, set("/A.x", 7)}));
    EXPECT_EQ(world.project->counters().dropped, 1u);
}

TEST_F(ProjectTransactions, M17ADeleteSaysWhatItsAuthorHadNotSeen) {
    const auto firstUnseen = [&](std::uint64_t sequence, std::vector<Edit> edits) {
        world.submit(1, sequence, std::move(edits));
        world.store();
        return world.nextFrame<CommitFrame>(2).commit.firstUnseen;
    };
    EXPECT_EQ(firstUnseen(1, {create("/C")}), 0u);
    EXPECT_EQ(firstUnseen(2, {set("/A.x", 7)}), 0u) << "it deletes nothing";
    EXPECT_EQ(firstUnseen(3, {erase("/A")}), 1u);
    EXPECT_EQ(firstUnseen(4, {erase("/A")}), 0u) << "it is dropped";
}

TEST_F(ProjectTransactions, M6ARefusalChangesNothing) {
    world.submit(1, 1, {create("/C"), move("/A", "/", "B")});
    expectRefusal(1, 1, ErrorCode::SpecExists);
    EXPECT_TRUE(world.host.appending.empty());
    EXPECT_FALSE(world.project->layer({"a.usda"})->has("/C"));
    EXPECT_TRUE(world.silent(2));
}

TEST_F(ProjectTransactions, SE5ARefusalFollowsItsAuthorsCommits) {
    world.submit(1, 1, {create("/C")});
    world.submit(1, 2, {move("/A", "/", "B")});
    world.submit(2, 1, {move("/A", "/", "B")});
    expectRefusal(2, 1, ErrorCode::SpecExists);
    EXPECT_TRUE(world.silent(1));
    world.store();
    world.nextFrame<CommitFrame>(1);
    expectRefusal(1, 2, ErrorCode::SpecExists);
}

TEST_F(ProjectTransactions, M9ATransactionSentTwiceCommitsOnce) {
    world.submit(1, 1, {create("/C")});
    world.submit(1, 1, {create("/C")});  // on its way to the store
    EXPECT_EQ(world.host.appending.size(), 1u);
    world.store();
    world.nextFrame<CommitFrame>(1);
    EXPECT_EQ(world.nextControl<AlreadyCommitted>(1), (AlreadyCommitted{1, 1}));
    world.submit(1, 1, {create("/C")});  // durable
    EXPECT_EQ(world.nextControl<AlreadyCommitted>(1), (AlreadyCommitted{1, 1}));
    EXPECT_EQ(world.project->counters().duplicates, 2u);
}

TEST_F(ProjectTransactions, M9AlsoWhenItsAuthorReconnectsWhileItIsBeingStored) {
    world.submit(1, 1, {create("/C")});
    world.project->disconnected(1);
    Hello hello = world.hello(1);
    hello.resume = Hello::Resume{1, 0, {}};
    world.connect(3, hello);
    EXPECT_TRUE(world.nextControl<Welcome>(3).resumed);
    world.receive(3, Frame(SubmitFrame{{{world.client(1), 1}, 0, 0, {create("/C")}}}));
    EXPECT_TRUE(world.silent(3));
    world.store();
    EXPECT_EQ(world.nextFrame<CommitFrame>(3).commit.revision, 1u);
    EXPECT_EQ(world.nextControl<AlreadyCommitted>(3), (AlreadyCommitted{1, 1}));
}

TEST_F(ProjectTransactions, ALayerThatIsNotLoadedIsLoadedAndLaterOnesWait) {
    world.submit(1, 1, {set("/A.x", 1, {"b.usda"})});
    world.submit(1, 2, {create("/C")});
    EXPECT_TRUE(world.host.appending.empty());
    ASSERT_EQ(world.host.loading.size(), 1u);
    world.load();
    ASSERT_EQ(world.host.appending.size(), 2u);
    EXPECT_EQ(world.host.appending[0].id.sequence, 1u);
}

TEST_F(ProjectTransactions, ALayerThatCannotBeLoadedRefuses) {
    world.submit(1, 1, {set("/A.x", 1, {"b.usda"})});
    world.submit(1, 2, {create("/C")});
    world.host.loading.clear();
    world.project->layerLoaded({"b.usda"}, fail(ErrorCode::LayerUnreadable, "no layer"));
    expectRefusal(1, 1, ErrorCode::LayerUnreadable);
    EXPECT_EQ(world.host.appending.size(), 1u);
    world.submit(1, 3, {set("/A.x", 1, {"b.usda"})});
    EXPECT_EQ(world.host.loading.size(), 1u);  // another attempt
}

TEST_F(ProjectTransactions, UnknownLayersAreRefused) {
    world.submit(1, 1, {create("/C"), create("/C", {"c.usda"})});
    EXPECT_EQ(expectRefusal(1, 1, ErrorCode::LayerNotFound).edit, 1u);
}

TEST_F(ProjectTransactions, WithoutSpaceEditsAreRefusedUntilThereIsSome) {
    world.project->setSpace(false);
    world.submit(1, 1, {create("/C")});
    expectRefusal(1, 1, ErrorCode::StorageFull);
    world.project->setSpace(true);
    world.submit(1, 2, {create("/C")});
    world.store();
    EXPECT_EQ(world.nextFrame<CommitFrame>(1).commit.revision, 1u);
}

// A later transaction must not be committed before the refused one that it builds on.
TEST_F(ProjectTransactions, SE21AfterARefusalThatPassesTheAuthorsOrderIsKept) {
    Hello hello = world.hello(3);
    hello.features = {"resends"};
    world.connect(3, hello);
    world.nextControl<Welcome>(3);
    world.project->setSpace(false);
    world.submit(3, 1, {create("/C")});
    expectRefusal(3, 1, ErrorCode::StorageFull);
    world.project->setSpace(true);
    world.submit(3, 2, {create("/D")});  // it was on its way
    expectRefusal(3, 2, ErrorCode::StorageFull);
    world.submit(1, 1, {create("/E")});  // others are not concerned
    world.submit(3, 1, {create("/C")});
    world.submit(3, 2, {create("/D")});
    world.store();
    EXPECT_EQ(world.nextFrame<CommitFrame>(3).commit.id.client, world.client(1));
    EXPECT_EQ(world.nextFrame<CommitFrame>(3).commit.id, (TransactionId{world.client(3), 1}));
    EXPECT_EQ(world.nextFrame<CommitFrame>(3).commit.id, (TransactionId{world.client(3), 2}));
}

TEST_F(ProjectTransactions, SE21AlsoAfterALostCommit) {
    Hello hello = world.hello(3);
    hello.features = {"resends"};
    world.connect(3, hello);
    world.nextControl<Welcome>(3);
    world.submit(3, 1, {create("/C")});
    world.host.appending.clear();
    world.project->appendFailed({ErrorCode::StorageFull, "full"}, {});
    expectRefusal(3, 1, ErrorCode::StorageFull);
    world.load();
    world.submit(3, 2, {create("/D")});
    expectRefusal(3, 2, ErrorCode::StorageFull);
    world.submit(3, 1, {create("/C")});
    world.submit(3, 2, {create("/D")});
    world.store();
    EXPECT_EQ(world.nextFrame<CommitFrame>(3).commit.id.sequence, 1u);
    EXPECT_EQ(world.nextFrame<CommitFrame>(3).commit.id.sequence, 2u);
}

TEST_F(ProjectTransactions, BigValuesMustBeStored) {
    const Hash hash = sha256(asBytes("points"));
    const auto big = Value::blob(arrayOf(ValueType::Float3), hash, 12'000'000);
    const Edit edit{{"a.usda"}, {"/A.x", {}}, SetField{"default", {}, big, {}}};
    world.submit(1, 1, {create("/C"), edit});
    EXPECT_EQ(expectRefusal(1, 1, ErrorCode::BlobNotFound).edit, 1u);
    world.host.blobs.insert(hash);
    world.submit(1, 2, {edit});
    EXPECT_EQ(world.host.appending.size(), 1u);
}

TEST_F(ProjectTransactions, TooManyEditsAreRefused) {
    Project::Options options;
    options.maxEditsPerTransaction = 2;
    world.options = options;
    world.restart();
    world.join(1);
    world.submit(1, 1, {create("/C"), create("/D"), create("/E")});
    expectRefusal(1, 1, ErrorCode::TransactionTooLarge);
}

TEST_F(ProjectTransactions, ACommitThatIsTooLargeIsRefusedAndUndone) {
    world.options.maxFrameBytes = world.options.maxTransactionBytes = 64 * 1024;
    world.restart();
    world.join(1);
    const std::string longName(12'000, 'n');
    world.submit(1, 1, {create("/" + longName)});
    world.load();
    world.store();
    world.nextFrame<CommitFrame>(1);
    // Eight edits of a few bytes each, which are encoded with the long path.
    std::vector<Edit> edits;
    for (int number = 0; number < 8; ++number)
        edits.push_back(inCreated(1, 0, "/C" + std::to_string(number), CreateSpec{}));
    world.submit(1, 2, edits);
    expectRefusal(1, 2, ErrorCode::TransactionTooLarge);
    world.submit(1, 3, {create("/C")}, 1);
    world.submit(2, 1, {create("/D")}, 1);
    EXPECT_FALSE(world.project->layer({"a.usda"})->has("/" + longName + "/C0"));
    EXPECT_EQ(world.host.appending.size(), 1u);
}

TEST_F(ProjectTransactions, AMalformedPathIsRefusedAndTheSessionClosed) {
    world.submit(1, 1, {create("/C")});
    world.submit(1, 2, {create("not a path")});
    world.submit(1, 3, {create("/D")});
    EXPECT_FALSE(world.host.closed.contains(1));
    world.store();
    world.nextFrame<CommitFrame>(1);
    expectRefusal(1, 2, ErrorCode::InvalidPath);
    EXPECT_TRUE(world.nextControl<ErrorMessage>(1).closing);
    EXPECT_TRUE(world.host.closed.contains(1));
    EXPECT_TRUE(world.silent(1));
}

TEST_F(ProjectTransactions, TransactionsInTheNameOfOthersAreRefused) {
    world.receive(1, Frame(SubmitFrame{{{world.client(2), 1}, 0, 0, {create("/C")}}}));
    EXPECT_TRUE(world.nextControl<ErrorMessage>(1).closing);
    EXPECT_TRUE(world.host.appending.empty());
}

TEST_F(ProjectTransactions, ATransactionOfDroppedEditsIsStillACommit) {
    world.submit(1, 1, {inCreated(9, 0, "", DeleteSpec{})});
    world.store();
    const auto commit = world.nextFrame<CommitFrame>(1).commit;
    EXPECT_TRUE(commit.edits.empty());
    EXPECT_EQ(commit.dropped.size(), 1u);
}

TEST_F(ProjectTransactions, SE6ABaseFromTooLongAgoIsStale) {
    world.options.namespaceLogRevisions = 2;
    world.restart();
    world.join(1);
    world.submit(1, 1, {create("/C")});
    world.load();
    for (std::uint64_t number = 2; number <= 5; ++number)
        world.submit(1, number, {set("/A.x", double(number))}, number - 1);
    world.store();
    world.submit(1, 6, {set("/A.x", 0)}, 2);
    world.submit(1, 7, {set("/A.x", 0)}, 3);
    world.submit(1, 8, {set("/A.x", 0)}, 8);
    world.store();
    for (int commit = 0; commit < 5; ++commit) world.nextFrame<CommitFrame>(1);
    expectRefusal(1, 6, ErrorCode::StaleBase);
    world.nextFrame<CommitFrame>(1);
    expectRefusal(1, 8, ErrorCode::FutureRevision);
}

TEST_F(ProjectTransactions, AnAuthorsCreationsAreFoundWhenItComesBack) {
    world.submit(1, 1, {create("/C")});
    world.store();
    world.submit(2, 1, {move("/C", "/A", "D")}, 1);
    world.store();
    world.project->disconnected(1);
    world.join(1);
    world.submit(1, 2, {inCreated(1, 0, "/E", CreateSpec{SpecKind::Prim})});
    world.answerRead();
    world.store();
    EXPECT_EQ(world.nextFrame<CommitFrame>(1).commit.edits.at(0).address.path, "/A/D/E");
}

TEST_F(ProjectTransactions, ADroppedCreationCountsInTheNumbersOfTheOthers) {
    world.submit(2, 1, {erase("/A")});
    world.submit(1, 1, {create("/A/C"), create("/D"), create("/A/E"), create("/F")});
    world.store();
    const LayerDoc doc = *world.project->layer({"a.usda"});
    world.restart();
    world.join(1);
    world.submit(1, 2,
                 {inCreated(1, 3, "/G", CreateSpec{SpecKind::Prim}),
                  inCreated(1, 0, "/G", CreateSpec{SpecKind::Prim})});
    world.project->layerLoaded({"a.usda"}, LoadedLayer{doc});
    world.answerRead();
    world.store();
    const auto commit = world.nextFrame<CommitFrame>(1).commit;
    EXPECT_EQ(commit.edits.at(0).address.path, "/F/G");
    EXPECT_EQ(commit.dropped.at(0).index, 1u);
}

TEST_F(ProjectTransactions, ChangedFramesDoNoHarmToOthers) {
    std::mt19937_64 random(11);
    const std::vector<Frame> samples{
        SubmitFrame{{{world.client(3), 1}, 0, 3, {create("/C"), set("/A.x", 1), erase("/B")}}},
        PreviewFrame{{}, 3, 0, {set("/A.x", 1)}},
        BlobFrame{sha256(asBytes("x")), 3, 0, 3, deflate(asBytes("xyz"))},
        ControlFrame{encodeControl(OpenLayer{1, {"a.usda"}, 0})},
        ControlFrame{encodeControl(RequestLog{1, 0, 0})},
        ControlFrame{encodeControl(SaveLayers{1, {}})}};
    for (int round = 0; round < 3'000; ++round) {
        world.join(3);
        for (int count = 0; count < 4; ++count) {
            Bytes message = encodeFrame(samples[random() % samples.size()]);
            for (std::uint64_t change = random() % 3; change > 0; --change)
                message[random() % message.size()] = std::uint8_t(random());
            world.project->received(3, message);
        }
        world.project->disconnected(3);
        while (!world.host.loading.empty()) world.load();
        while (!world.host.reading.empty()) world.answerRead();
        world.store();
    }
    world.host.sent.clear();
    world.submit(1, 1, {create("/Last")}, 0);
    world.store();
    EXPECT_EQ(world.nextFrame<CommitFrame>(2).commit.edits.at(0), create("/Last"));
}

TEST_F(ProjectTransactions, AnAbandonedConnectionIsClosed) {
    world.submit(1, 1, {set("/A.x", 1, {"b.usda"})});  // waits for its layer
    Hello hello = world.hello(1);
    world.connect(3, hello);
    EXPECT_TRUE(world.host.closed.contains(1));
    world.nextControl<Welcome>(3);
    world.load();
    EXPECT_TRUE(world.host.appending.empty());
    world.submit(1, 2, {create("/C")});
    EXPECT_TRUE(world.host.appending.empty());
}

// ---- a store that fails

TEST_F(ProjectTransactions, CommitsThatWereNotStoredAreReportedToTheirAuthorsOnly) {
    world.submit(1, 1, {create("/C")});
    world.submit(1, 2, {create("/D")});
    Hello hello = world.hello(1);
    world.connect(3, hello);
    world.nextControl<Welcome>(3);
    world.receive(3, Frame(SubmitFrame{{{world.client(1), 2}, 0, 0, {create("/D")}}}));
    world.host.appending.clear();
    world.project->setSpace(false);
    world.project->appendFailed({ErrorCode::StorageFull, "full"}, {});
    expectRefusal(3, 2, ErrorCode::StorageFull);
    EXPECT_TRUE(world.silent(3));
    EXPECT_TRUE(world.silent(2));
}

TEST_F(ProjectTransactions, CommitsThatWereNotStoredAreRevertedInOrder) {
    world.submit(1, 1, {create("/C")});
    world.store();
    world.host.sent.clear();
    const auto head = CommitStore::Head{1, world.host.log.back().hash, 1};
    world.submit(1, 2, {create("/D")}, 1);
    world.submit(1, 3, {move("/A", "/", "B")}, 1);  // refused; the answer waits for that to 2
    world.submit(2, 1, {create("/E")}, 1);
    world.host.appending.clear();
    world.project->setSpace(false);
    world.project->appendFailed({ErrorCode::StorageFull, "full"}, head);
    expectRefusal(1, 2, ErrorCode::StorageFull);
    expectRefusal(1, 3, ErrorCode::SpecExists);
    expectRefusal(2, 1, ErrorCode::StorageFull);
    EXPECT_EQ(world.project->layer({"a.usda"}), nullptr);  // loaded again
    ASSERT_EQ(world.host.loading.size(), 1u);
    world.load();
    world.project->setSpace(true);
    world.submit(1, 4, {create("/D")}, 1);
    world.store();
    const auto commit = world.nextFrame<CommitFrame>(1).commit;
    EXPECT_EQ(commit.revision, 2u);
    EXPECT_EQ(commit.previous, head.hash);
}

TEST_F(ProjectTransactions, AfterAFailureItContinuesWithTheReopenedStore) {
    world.submit(1, 1, {create("/C")});
    world.submit(1, 2, {create("/D")});
    // The store has the first commit after all.
    const auto head = CommitStore::Head{1, world.host.appending.front().hash, 2};
    world.host.appending.clear();
    world.project->appendFailed({ErrorCode::StorageFailed, "sync"}, head);
    EXPECT_EQ(world.nextFrame<CommitFrame>(1).commit.id.sequence, 1u);
    expectRefusal(1, 2, ErrorCode::StorageFailed);
    world.load();
    world.submit(1, 3, {create("/E")}, 1);
    world.store();
    const auto commit = world.nextFrame<CommitFrame>(1).commit;
    EXPECT_EQ(commit.revision, 2u);
    EXPECT_EQ(commit.epoch, 2u);
}

// SE8: work that may be in the store waits; the rest is refused.
TEST_F(ProjectTransactions, WhileTheStoreIsClosedNewWorkIsRefusedAndUncertainWorkWaits) {
    world.submit(1, 1, {create("/C")});
    world.store();
    world.host.sent.clear();
    const auto head = CommitStore::Head{1, world.host.log.back().hash, 2};
    world.submit(1, 2, {create("/D")}, 1);
    world.host.appending.clear();
    world.project->storeClosed();
    world.submit(1, 3, {create("/E")}, 1);  // refused; the answer comes after that to 2
    world.join(3);
    world.submit(3, 1, {create("/F")}, 1);  // the server does not know this client's commits
    EXPECT_TRUE(world.silent(1));
    EXPECT_TRUE(world.silent(3));

    world.project->appendFailed({ErrorCode::StorageFailed, "sync"}, head);
    expectRefusal(1, 2, ErrorCode::StorageFailed);
    expectRefusal(1, 3, ErrorCode::StorageFailed);
    world.load();
    world.answerQuestions();
    world.store();
    EXPECT_EQ(world.nextFrame<CommitFrame>(3).commit.edits.front().address.path, "/F");
}

TEST_F(ProjectTransactions, AnAuthorWithNothingOnTheWayIsRefusedAtOnceWhileTheStoreIsClosed) {
    world.submit(1, 1, {create("/C")});
    world.store();
    world.host.sent.clear();
    world.project->storeClosed();
    world.submit(1, 2, {create("/D")}, 1);
    expectRefusal(1, 2, ErrorCode::StorageFailed);
    world.submit(1, 1, {create("/C")});  // sent again: the store has it
    EXPECT_EQ(world.nextControl<AlreadyCommitted>(1), (AlreadyCommitted{1, 1}));
}

}  // namespace
}  // namespace usdlive::server::projecttest
