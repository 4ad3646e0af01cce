// Tests B6: unused values are removed after some time; values that something names stay.

#include <gtest/gtest.h>

#include "FakeHost.h"

namespace usdlive::server::projecttest {
namespace {

constexpr std::int64_t kKeepMs = 1'000;

Hash hashOf(unsigned number) { return sha256(asBytes(std::to_string(number))); }
Edit setBig(unsigned number) {
    return {
        {"a.usda"},
        {"/A.x", {}},
        SetField{
            "default", {}, Value::blob(arrayOf(ValueType::Float), hashOf(number), 300'000), {}}};
}
Project::Options options() {
    Project::Options options;
    options.keepUnusedBlobsMs = kKeepMs;
    return options;
}

class UnusedBlobs : public testing::Test {
public:
    UnusedBlobs() {
        world.join(1);
        world.receive(1, ControlMessage(OpenLayer{5, {"a.usda"}, 0}));
        world.load();
        world.host.sent[1].clear();
    }
    /// The session uploads a value, or its last chunk.
    void upload(unsigned number, SessionId session = 1) {
        const Bytes raw{1};
        world.receive(session, Frame(BlobFrame{hashOf(number), 300'000, 299'999, 1, deflate(raw)}));
        if (!world.host.blobs.insert(hashOf(number)).second) return;
        world.project->blobWritten(session, hashOf(number), true);
    }
    /// Runs a round at this time; the store names none of these values.
    std::vector<Hash> round(std::int64_t nowMs, const std::vector<unsigned>& numbers,
                            std::optional<Revision> upTo = {}) {
        std::vector<Hash> unnamed;
        for (const unsigned number : numbers)
            if (world.host.blobs.contains(hashOf(number))) unnamed.push_back(hashOf(number));
        const auto going = world.project->unusedBlobs(
            unnamed, upTo.value_or(world.project->durableRevision()), nowMs);
        for (const Hash& hash : going) world.host.blobs.erase(hash);
        return going;
    }
    using Hashes = std::vector<Hash>;

    World world{options()};
};

TEST_F(UnusedBlobs, B6AreRemovedAfterATime) {
    upload(1);
    EXPECT_EQ(round(0, {1}), Hashes());
    EXPECT_EQ(round(kKeepMs - 1, {1}), Hashes());
    EXPECT_EQ(round(kKeepMs, {1}), Hashes{hashOf(1)});
    // A client that names it now uploads it again.
    world.submit(1, 1, {setBig(1)});
    world.host.sent[1].clear();
    world.submit(1, 2, {setBig(1)});
    EXPECT_EQ(world.nextFrame<RefusalFrame>(1).error.code, ErrorCode::BlobNotFound);
    upload(1);
    world.submit(1, 3, {setBig(1)});
    EXPECT_EQ(world.host.appending.size(), 1u);
}

TEST_F(UnusedBlobs, B6ValuesFromBeforeTheStartAreKeptForTheWholeTime) {
    world.host.blobs.insert(hashOf(1));
    EXPECT_EQ(round(50'000, {1}), Hashes());
    EXPECT_EQ(round(50'000 + kKeepMs, {1}), Hashes{hashOf(1)});
}

TEST_F(UnusedBlobs, B6TheTimeStartsAgainWithEachAcknowledgement) {
    upload(1);
    EXPECT_EQ(round(0, {1}), Hashes());
    world.join(2);
    upload(1, 2);
    EXPECT_EQ(world.nextControl<BlobStored>(2).hash, hashOf(1));
    EXPECT_EQ(round(kKeepMs, {1}), Hashes());
    EXPECT_EQ(round(2 * kKeepMs - 1, {1}), Hashes());
    EXPECT_EQ(round(2 * kKeepMs, {1}), Hashes{hashOf(1)});
}

// A transaction may name more values than can be uploaded in that time.
TEST_F(UnusedBlobs, B6ValuesOfASessionThatStillUploadsAreKept) {
    for (unsigned number = 1; number < 10; ++number) {
        upload(number);
        EXPECT_EQ(round(number * kKeepMs, {1, 2, 3, 4, 5, 6, 7, 8, 9}), Hashes());
    }
    EXPECT_EQ(round(10 * kKeepMs, {1, 2, 3}).size(), 3u);
}

TEST_F(UnusedBlobs, B6ValuesOfACommitThatTheStoreDoesNotReportYetStay) {
    upload(1);
    EXPECT_EQ(round(0, {1}), Hashes());
    const Revision before = world.project->durableRevision();
    world.submit(1, 1, {setBig(1)});
    ASSERT_EQ(world.host.appending.size(), 1u);
    EXPECT_EQ(round(9 * kKeepMs, {1}, before), Hashes()) << "on its way";
    world.store();
    EXPECT_EQ(round(10 * kKeepMs, {1}, before), Hashes()) << "the store was read before";
    // From now on the store names it.
    EXPECT_EQ(round(11 * kKeepMs, {}), Hashes());
    EXPECT_EQ(round(12 * kKeepMs, {1}), Hashes()) << "its history was replaced";
    EXPECT_EQ(round(13 * kKeepMs, {1}), Hashes{hashOf(1)});
}

// Seed 51 of the simulation found this: a commit also contains its dropped edits (M4).
TEST_F(UnusedBlobs, B6ValuesOfDroppedEditsStay) {
    upload(1);
    EXPECT_EQ(round(0, {1}), Hashes());
    const Revision before = world.project->durableRevision();
    world.submit(1, 1, {erase("/A.x")});
    world.submit(1, 2, {setBig(1)});
    ASSERT_EQ(world.host.appending.size(), 2u);
    EXPECT_EQ(round(5 * kKeepMs, {1}, before), Hashes());
}

TEST_F(UnusedBlobs, B6NothingIsRemovedBecauseOfAnOlderReadingOfTheStore) {
    upload(1);
    EXPECT_EQ(round(0, {1}), Hashes());
    const Revision before = world.project->durableRevision();
    world.submit(1, 1, {setBig(1)});
    world.store();
    EXPECT_EQ(round(kKeepMs, {}), Hashes());
    EXPECT_EQ(round(2 * kKeepMs, {1}, before), Hashes());
    EXPECT_EQ(round(4 * kKeepMs, {1}, before), Hashes());
}

TEST_F(UnusedBlobs, B6ValuesOfAPreviewOrAWaitingTransactionStay) {
    upload(1);
    upload(2);
    EXPECT_EQ(round(0, {1, 2}), Hashes());
    world.receive(1, Frame(PreviewFrame{{}, 7, 0, {setBig(1)}}));
    Edit waits = setBig(2);
    waits.layer = {"b.usda"};
    world.submit(1, 1, {waits});
    world.project->layerReloaded(1, 1, {"b.usda"}, fail(ErrorCode::Internal, "not asked for"));
    EXPECT_EQ(round(5 * kKeepMs, {1, 2}), Hashes()) << "a layer is loaded";
    world.load();
    EXPECT_EQ(round(6 * kKeepMs, {1, 2}), Hashes());
    world.store();
    world.receive(1, Frame(PreviewFrame{{}, 7, 0, {}}));
    EXPECT_EQ(round(7 * kKeepMs, {1}), Hashes());
    EXPECT_EQ(round(8 * kKeepMs, {1}), Hashes{hashOf(1)});
}

TEST_F(UnusedBlobs, B6NothingIsRemovedWhileFilesAreReadOrWritten) {
    upload(1);
    EXPECT_EQ(round(0, {1}), Hashes());
    world.receive(1, ControlMessage(OpenLayer{6, {"b.usda"}, 0}));
    EXPECT_EQ(round(5 * kKeepMs, {1}), Hashes());
    world.load();
    world.receive(1, ControlMessage(ReloadLayers{7, {{"a.usda"}}}));
    EXPECT_EQ(round(6 * kKeepMs, {1}), Hashes());
    world.project->layerReloaded(1, 7, {"a.usda"}, fail(ErrorCode::LayerUnreadable, "gone"));
    world.receive(1, ControlMessage(SaveLayers{8, {{"a.usda"}}, {}}));
    ASSERT_EQ(world.host.saves.size(), 1u);
    EXPECT_EQ(round(7 * kKeepMs, {1}), Hashes());
    world.project->layersSaved(1, 8, {});
    EXPECT_EQ(round(8 * kKeepMs, {1}), Hashes{hashOf(1)});
}

// Only the commit of an import names a value of the imported layer.
TEST_F(UnusedBlobs, B6ValuesOfAnImportStay) {
    world.host.blobs.insert(hashOf(1));
    EXPECT_EQ(round(0, {1}), Hashes());
    world.receive(1, ControlMessage(OpenLayer{6, {"b.usda"}, 0}));
    LoadedLayer loaded{World::sample()};
    (void)loaded.doc.apply("/A.x", setBig(1).action);
    loaded.import = *makeImport({"b.usda"}, loaded.doc);
    const Revision before = world.project->durableRevision();
    world.project->layerLoaded({"b.usda"}, loaded);
    EXPECT_EQ(round(5 * kKeepMs, {1}, before), Hashes());
    world.store();
    EXPECT_EQ(round(6 * kKeepMs, {1}, before), Hashes());
}

TEST_F(UnusedBlobs, B6NothingIsRemovedBecauseOfAnEarlierProjectsReading) {
    world.submit(1, 1, {set("/A.x", 1)});
    world.store();
    world.restart();
    world.host.blobs.insert(hashOf(1));
    EXPECT_EQ(round(0, {1}, 0), Hashes());
    EXPECT_EQ(round(5 * kKeepMs, {1}, 0), Hashes()) << "the store was read before the restart";
    EXPECT_EQ(round(6 * kKeepMs, {1}, 1), Hashes());
    world.project->storeClosed();
    EXPECT_EQ(round(9 * kKeepMs, {1}, 1), Hashes()) << "its content is unknown";
}

// Otherwise the store's answer could be wrong when it arrives.
TEST_F(UnusedBlobs, B6ValuesThatTheStoreChecksOrWritesStay) {
    world.host.blobs.insert(hashOf(1));
    EXPECT_EQ(round(0, {1}), Hashes());
    world.answers = false;
    world.receive(1, ControlMessage(RequestBlob{hashOf(1), 0}));
    EXPECT_EQ(round(5 * kKeepMs, {1}), Hashes());
    world.answerQuestions();
    EXPECT_EQ(world.host.blobsSent.size(), 1u);
    EXPECT_EQ(round(6 * kKeepMs, {1}), Hashes()) << "the value was used meanwhile";
    EXPECT_EQ(round(7 * kKeepMs, {1}), Hashes{hashOf(1)});

    const Bytes raw{1};
    world.receive(1, Frame(BlobFrame{hashOf(2), 300'000, 299'999, 1, deflate(raw)}));
    world.host.blobs.insert(hashOf(2));
    EXPECT_EQ(round(8 * kKeepMs, {2}), Hashes());
    EXPECT_EQ(round(20 * kKeepMs, {2}), Hashes());
    world.project->blobWritten(1, hashOf(2), true);
    EXPECT_EQ(world.nextControl<BlobStored>(1).hash, hashOf(2));
}

// Other events for the session do not replace the store's answer.
TEST_F(UnusedBlobs, ATransactionWaitsUntilTheStoreHasAnswered) {
    world.host.blobs.insert(hashOf(1));
    world.answers = false;
    world.submit(1, 1, {setBig(1)});
    world.receive(1, ControlMessage(OpenLayer{9, {"b.usda"}, 0}));
    world.load();
    EXPECT_TRUE(world.host.appending.empty());
    world.answerQuestions();
    EXPECT_EQ(world.host.appending.size(), 1u);
    world.store();
    world.host.sent[1].clear();
    world.submit(1, 2, {setBig(2)});
    world.answerQuestions();
    EXPECT_EQ(world.nextFrame<RefusalFrame>(1).error.code, ErrorCode::BlobNotFound);
}

// The parts of a value that is refused would keep the disk full until its session ends.
TEST_F(UnusedBlobs, SE8AFullDiskKeepsNoPartOfAValue) {
    world.project->setSpace(false);
    world.receive(1, Frame(BlobFrame{hashOf(1), 300'000, 100'000, 1, deflate(Bytes{1})}));
    EXPECT_EQ(world.host.withoutUnfinished, std::set<SessionId>{1});
    EXPECT_TRUE(world.host.blobParts.empty());
    world.project->setSpace(true);
    upload(1);
    EXPECT_EQ(world.host.blobParts.size(), 1u);
}

// A commit that the store could not append does not protect a value for ever, even if no commit
// follows.
TEST_F(UnusedBlobs, B6ValuesOfALostCommitAreRemoved) {
    upload(1);
    EXPECT_EQ(round(0, {1}), Hashes());
    world.submit(1, 1, {setBig(1)});
    ASSERT_EQ(world.host.appending.size(), 1u);
    world.project->appendFailed({ErrorCode::StorageFull, "full"}, {0, {}, 1});
    world.host.appending.clear();
    world.load();
    EXPECT_EQ(round(kKeepMs, {1}), Hashes());
    EXPECT_EQ(round(2 * kKeepMs, {1}), Hashes{hashOf(1)});
}

}  // namespace
}  // namespace usdlive::server::projecttest
