// Tests layers whose files are changed behind the server (FI1-FI3).
#include <gtest/gtest.h>

#include <algorithm>

#include "FakeHost.h"
#include "unit/common/layer/RandomEdits.h"
#include "usdlive/common/layer/GlobalMuteness.h"
#include "usdlive/common/layer/LayerLock.h"

namespace usdlive::server::projecttest {
namespace {

const LayerId kLayer{"a.usda"};

Hash hashOf(std::string_view content) { return sha256(asBytes(content)); }

/// A layer that was saved to a file, opened by two sessions that receive states.
class FilesTest : public ::testing::Test {
protected:
    explicit FilesTest(const Project::Options& options = {}) : world(options) {
        world.project->setFiles({{kLayer, trace(1), true, "ada"}, {{"b.usda"}, trace(1)}});
        for (const SessionId session : {1, 2}) {
            Hello hello = world.hello(session);
            hello.features = {"states"};
            world.connect(session, hello);
            world.receive(session, ControlMessage(OpenLayer{1, kLayer, 0}));
        }
        world.host.loading.clear();
        LoadedLayer loaded{World::sample()};
        loaded.saved = {0, FileStamp{trace(1), hashOf("one")}};
        world.project->layerLoaded(kLayer, std::move(loaded));
        world.host.sent.clear();
    }

    static FileTrace trace(std::int64_t time) { return {100, 7, time, time}; }
    void look(std::int64_t time, bool writable = true) {
        world.project->setFiles({{kLayer, trace(time), writable, "ada"}, {{"b.usda"}, trace(1)}});
    }
    /// Answers the check of the file with this content.
    void check(std::int64_t time, std::string_view content) {
        ASSERT_EQ(world.host.checking, std::vector{kLayer});
        world.host.checking.clear();
        world.project->fileChecked(kLayer, std::optional(FileStamp{trace(time), hashOf(content)}));
    }
    LayerState state(SessionId session = 2) {
        const auto received = world.nextControl<LayerStates>(session);
        EXPECT_EQ(received.layers.size(), 1u);
        return received.layers.at(0);
    }
    void changeBehind() {
        look(2);
        check(2, "two");
        ASSERT_TRUE(state(1).outdated);
        ASSERT_TRUE(state(2).outdated);
    }
    /// Answers the first requested reload with this content of the file.
    void read(const LayerDoc& content) {
        const FakeHost::Reload reload = std::move(world.host.reloading.front());
        world.host.reloading.pop_front();
        world.project->layerReloaded(
            reload.session, reload.request, reload.layer,
            makeReload(reload.layer, reload.present, content, {trace(2), hashOf("two")}));
    }
    static LayerDoc other() {
        LayerDoc doc;
        (void)doc.apply("/B", CreateSpec{SpecKind::Prim});
        (void)doc.apply("/C", CreateSpec{SpecKind::Prim});
        (void)doc.apply("/A", CreateSpec{SpecKind::Prim});
        (void)doc.apply("/A.x", CreateSpec{SpecKind::Attribute});
        (void)doc.apply("/A.x", SetField{"default", {}, doubleValue(3), {}});
        return doc;
    }

    World world;
};

TEST_F(FilesTest, FI1AFileWithOtherContentIsOutdated) {
    look(2);
    check(2, "two");
    const LayerState received = state();
    EXPECT_TRUE(received.outdated);
    EXPECT_FALSE(received.dirty);
    EXPECT_EQ(received.owner, "ada");
    look(2);
    EXPECT_TRUE(world.host.checking.empty()) << "the file was compared already";
    look(3);
    check(3, "one");
    EXPECT_FALSE(state().outdated) << "the file was restored";
}

TEST_F(FilesTest, FI1ATouchedFileIsNotOutdated) {
    look(2);
    check(2, "one");
    EXPECT_TRUE(world.silent(2));
    look(2);
    EXPECT_TRUE(world.host.checking.empty());
}

TEST_F(FilesTest, FI1AMissingFileMakesTheLayerDirtyAndReadOnlyIsReported) {
    look(1, false);
    EXPECT_FALSE(state().writable);
    world.project->setFiles({{kLayer, {}, true, ""}, {{"b.usda"}, trace(1)}});
    const LayerState received = state();
    EXPECT_TRUE(received.dirty);
    EXPECT_FALSE(received.outdated);
    world.receive(1, ControlMessage(SaveLayers{5, {}, {}}));
    ASSERT_EQ(world.host.saves.size(), 1u);
    world.project->layersSaved(1, 5, {0, {{kLayer, FileStamp{trace(4), hashOf("one")}}}, {}});
    EXPECT_FALSE(state().dirty);
    look(4);
    EXPECT_TRUE(world.host.checking.empty()) << "it is the file just written";
}

// Simulates a server that dies after it has replaced the file and before it has noted that.
TEST_F(FilesTest, FI1AFileThatASaveWasAboutToWriteIsOurs) {
    World restarted;
    restarted.unsaved = {kLayer};  // commits after it changed the layer
    restarted.start();
    restarted.project->setFiles({{kLayer, trace(2), true, "ada"}});
    Hello hello = restarted.hello(1);
    hello.features = {"states"};
    restarted.connect(1, hello);
    restarted.host.sent.clear();
    restarted.receive(1, ControlMessage(OpenLayer{1, kLayer, 0}));
    LoadedLayer loaded{World::sample()};
    loaded.saved = {0, FileStamp{trace(1), hashOf("one")},
                    SavedState::PendingSave{0, hashOf("ours")}};
    restarted.project->layerLoaded(kLayer, std::move(loaded));
    ASSERT_EQ(restarted.host.checking, std::vector{kLayer});
    const FileStamp stamp{trace(2), hashOf("ours")};
    restarted.project->fileChecked(kLayer, std::optional(stamp));
    EXPECT_EQ(restarted.host.savedStates.at(kLayer), (SavedState{0, stamp}));
    const LayerState received = restarted.nextControl<LayerStates>(1).layers.at(0);
    EXPECT_TRUE(received.dirty);
    EXPECT_FALSE(received.outdated);
    restarted.host.sent.clear();
    restarted.receive(1, ControlMessage(SaveLayers{5, {kLayer}, {}}));
    EXPECT_EQ(restarted.host.saves.at(0).jobs.at(0).saved.file, stamp);
}

TEST_F(FilesTest, FI2ASaveNamesWhatTheFileMayHold) {
    changeBehind();
    world.receive(1, ControlMessage(SaveLayers{5, {kLayer}, {}}));
    world.receive(1, ControlMessage(SaveLayers{6, {kLayer}, true}));
    ASSERT_EQ(world.host.saves.size(), 2u);
    const auto& conditional = world.host.saves[0].jobs.at(0);
    EXPECT_TRUE(conditional.onlyIfUnchanged);
    EXPECT_EQ(conditional.saved.file->hash, hashOf("one"));
    EXPECT_FALSE(world.host.saves[1].jobs.at(0).onlyIfUnchanged);
    world.project->layersSaved(1, 6, {0, {{kLayer, FileStamp{trace(4), hashOf("ours")}}}, {}});
    EXPECT_FALSE(state().outdated);
}

TEST_F(FilesTest, FI3AReloadIsACommitOfItsRequester) {
    changeBehind();
    world.receive(1, ControlMessage(ReloadLayers{5, {}}));
    ASSERT_EQ(world.host.reloading.size(), 1u);
    read(other());
    EXPECT_TRUE(*world.project->layer(kLayer) == other());
    EXPECT_TRUE(world.silent(2)) << "nothing is received before it is durable";
    ASSERT_EQ(world.host.appending.size(), 1u);
    const CommitRecord& record = world.host.appending.front();
    EXPECT_EQ(record.id, TransactionId());
    EXPECT_EQ(record.saved->state, (SavedState{1, FileStamp{trace(2), hashOf("two")}}));
    world.store();
    const auto commit = world.nextFrame<CommitFrame>(2).commit;
    EXPECT_EQ(commit.user, UserName{"user1"});
    EXPECT_EQ(commit.id, TransactionId());
    LayerDoc doc = World::sample();
    for (const Edit& edit : commit.edits) ASSERT_TRUE(doc.apply(edit.address.path, edit.action));
    EXPECT_TRUE(doc == other());
    const LayerState received = state();
    EXPECT_FALSE(received.outdated);
    EXPECT_FALSE(received.dirty);
    EXPECT_EQ(received.saved, 1u);
    world.nextFrame<CommitFrame>(1);
    EXPECT_EQ(world.nextControl<LayersReloaded>(1), (LayersReloaded{5, 1, {kLayer}, {}}));
}

class ReloadsFiles : public FilesTest {
protected:
    static Project::Options options() {
        Project::Options options;
        options.reloadsFiles = true;
        return options;
    }
    ReloadsFiles() : FilesTest(options()) {}
};

TEST_F(ReloadsFiles, FI8AChangedFileIsReloadedByItself) {
    changeBehind();
    ASSERT_EQ(world.host.reloading.size(), 1u);
    read(other());
    EXPECT_TRUE(*world.project->layer(kLayer) == other());
    world.store();
    const auto commit = world.nextFrame<CommitFrame>(2).commit;
    EXPECT_EQ(commit.user, UserName());
    EXPECT_EQ(commit.label, "Reload of a.usda");
    const LayerState received = state();
    EXPECT_FALSE(received.outdated);
    EXPECT_FALSE(received.dirty);
    look(2);
    EXPECT_TRUE(world.host.checking.empty() && world.host.reloading.empty());
}

TEST_F(ReloadsFiles, FI8UnsavedEditsStay) {
    world.submit(2, 1, {create("/Mine")});
    world.store();
    world.host.sent.clear();
    look(2);
    check(2, "two");
    EXPECT_TRUE(world.host.reloading.empty());
    EXPECT_TRUE(world.project->layer(kLayer)->has("/Mine"));
}

TEST_F(ReloadsFiles, FI8EditsMadeMeanwhileStay) {
    changeBehind();
    world.submit(2, 1, {create("/Mine")});
    read(other());
    EXPECT_TRUE(world.project->layer(kLayer)->has("/Mine"));
    EXPECT_TRUE(world.host.reloading.empty());
    world.store();
    EXPECT_FALSE(world.project->layer(kLayer)->has("/C"));
    look(2);
    EXPECT_TRUE(world.host.checking.empty()) << "once for each change of the file";
}

TEST_F(ReloadsFiles, FI8AFileThatCannotBeReadIsTriedAgainWhenItChanges) {
    changeBehind();
    const FakeHost::Reload reload = std::move(world.host.reloading.front());
    world.host.reloading.pop_front();
    world.project->layerReloaded(reload.session, reload.request, reload.layer,
                                 fail(ErrorCode::LayerUnreadable, "half written"));
    EXPECT_TRUE(world.host.reloading.empty());
    world.host.sent.clear();
    look(3);
    check(3, "three");
    EXPECT_EQ(world.host.reloading.size(), 1u);
}

TEST_F(ReloadsFiles, FI8AReloadThatCouldNotBeStoredIsRepeated) {
    changeBehind();
    read(other());
    world.host.appending.clear();
    world.project->appendFailed({ErrorCode::StorageFull, "full"}, {0, {}, 1});
    ASSERT_EQ(world.host.loading.size(), 1u);
    LoadedLayer loaded{World::sample()};
    loaded.saved = {0, FileStamp{trace(1), hashOf("one")}};
    world.project->layerLoaded(kLayer, std::move(loaded));
    ASSERT_EQ(world.host.reloading.size(), 1u);
    read(other());
    EXPECT_TRUE(*world.project->layer(kLayer) == other());
}

TEST_F(FilesTest, FI3ALayerThatEqualsItsFileNeedsNoCommit) {
    changeBehind();
    world.receive(1, ControlMessage(ReloadLayers{5, {kLayer, {"none.usda"}}}));
    read(World::sample());
    EXPECT_TRUE(world.host.appending.empty());
    const auto answer = world.nextControl<LayersReloaded>(1);
    EXPECT_EQ(answer.reloaded, std::vector{kLayer});
    ASSERT_EQ(answer.failed.size(), 1u);
    EXPECT_EQ(answer.failed[0].code, "layerNotFound");
    EXPECT_EQ(world.host.savedStates.at(kLayer).file->hash, hashOf("two"));
    EXPECT_FALSE(state().outdated);
}

TEST_F(FilesTest, FI3EditsMadeMeanwhileAreReplacedByTheFile) {
    changeBehind();
    world.receive(1, ControlMessage(ReloadLayers{5, {kLayer}}));
    for (std::uint64_t edit = 1; edit <= 3; ++edit) {
        ASSERT_EQ(world.host.reloading.size(), 1u);
        world.submit(2, edit, {create("/E" + std::to_string(edit))});
        read(other());
    }
    EXPECT_TRUE(world.host.reloading.empty()) << "the reload does not repeat for ever";
    EXPECT_TRUE(*world.project->layer(kLayer) == other());
    EXPECT_EQ(world.host.appending.size(), 4u);
    world.store();
    EXPECT_FALSE(world.silent(1));
}

TEST_F(FilesTest, FI3IsRefusedIfSomebodyElseHoldsALock) {
    changeBehind();
    std::vector<Edit> edits;
    for (EditAction& action : lockEdits({true, {"user2"}, 0}))
        edits.push_back({kLayer, {"/", {}}, std::move(action)});
    world.submit(2, 1, edits);
    world.store();
    world.host.sent.clear();
    world.receive(1, ControlMessage(ReloadLayers{5, {kLayer}}));
    const auto answer = world.nextControl<LayersReloaded>(1);
    ASSERT_EQ(answer.failed.size(), 1u);
    EXPECT_EQ(answer.failed[0].code, "locked");
    EXPECT_TRUE(world.host.reloading.empty());
}

// The session may be closed because its user has lost the right to edit.
TEST_F(FilesTest, AC4AReloadOfASessionThatIsBeingClosedIsNotMade) {
    changeBehind();
    world.receive(1, ControlMessage(ReloadLayers{5, {kLayer}}));
    world.receive(1, ControlMessage(world.hello(1)));  // a second hello
    ASSERT_TRUE(world.host.closed.contains(1));
    read(other());
    EXPECT_TRUE(world.host.appending.empty());
    EXPECT_TRUE(*world.project->layer(kLayer) == World::sample());
}

TEST_F(FilesTest, FI3AReloadThatCouldNotBeStoredIsRepeated) {
    changeBehind();
    world.receive(1, ControlMessage(ReloadLayers{5, {kLayer}}));
    read(other());
    world.host.appending.clear();
    world.project->appendFailed({ErrorCode::StorageFull, "full"}, {0, {}, 1});
    EXPECT_TRUE(world.silent(1));
    ASSERT_EQ(world.host.loading.size(), 1u);
    LoadedLayer loaded{World::sample()};
    loaded.saved = {0, FileStamp{trace(1), hashOf("one")}};
    world.project->layerLoaded(kLayer, std::move(loaded));
    read(other());
    world.store();
    world.nextFrame<CommitFrame>(1);
    EXPECT_TRUE(*world.project->layer(kLayer) == other());
}

// The layer that was imported for a save or a reload is not there any more when its commit is lost.
TEST(ProjectFiles, FI3ASaveOfALayerWhoseImportWasLostIsAnswered) {
    World world;
    world.join(1);
    world.receive(1, ControlMessage(SaveLayers{7, {kLayer}, true}));
    world.load(true);
    EXPECT_TRUE(world.host.saves.empty()) << "the import is not durable";
    world.host.appending.clear();
    world.project->appendFailed({ErrorCode::StorageFull, "full"}, {0, {}, 1});
    ASSERT_EQ(world.host.loading.size(), 1u);
    world.load(true);
    world.store();
    ASSERT_EQ(world.host.saves.size(), 1u);
    EXPECT_EQ(world.host.saves[0].request, 7u);
    EXPECT_EQ(world.host.saves[0].jobs.at(0).saved.revision, 1u);
}

TEST_F(FilesTest, MU1EverybodyIsNotifiedOfTheMutesOfARootLayer) {
    const auto mute = [&](bool muted) {
        std::vector<Edit> edits;
        for (EditAction& action :
             globalMuteEdits(kLayer, *world.project->layer(kLayer), {"b.usda"}, muted))
            edits.push_back({kLayer, {"/", {}}, std::move(action)});
        world.submit(1, muted ? 1 : 2, edits, world.project->durableRevision());
        EXPECT_TRUE(world.silent(2)) << "nothing is received before it is durable";
        world.store();
        world.nextFrame<CommitFrame>(2);
        for (const LayerState& received : world.nextControl<LayerStates>(2).layers)
            if (received.layer == LayerId{"b.usda"}) return received.globallyMuted;
        return !muted;
    };
    EXPECT_TRUE(mute(true));
    EXPECT_FALSE(mute(false));
}

// Reloads random content over other random content.
TEST(Reload, FI3ResultsInTheContentOfTheFile) {
    for (unsigned seed = 0; seed < 300; ++seed) {
        SCOPED_TRACE(seed);
        RandomEdits random(seed);
        const auto change = [&](LayerDoc& doc, int edits) {
            for (int edit = 0; edit < edits; ++edit) {
                const auto [path, action] = random.edit(doc);
                (void)doc.apply(path, action);
            }
        };
        LayerDoc present, content;
        change(present, 60);
        if (seed % 3 == 0) content = present;
        change(content, seed % 3 == 0 ? 10 : 60);
        const ReloadedLayer reloaded = makeReload(kLayer, present, content, {});
        for (const Edit& edit : reloaded.edits)
            ASSERT_TRUE(present.apply(edit.address.path, edit.action)) << edit.address.path;
        EXPECT_EQ(present.dump(), content.dump());
        EXPECT_EQ(reloaded.doc.dump(), content.dump());
    }
}

}  // namespace
}  // namespace usdlive::server::projecttest
