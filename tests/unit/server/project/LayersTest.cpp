// Tests opening layers, snapshots, saves, big values and previews in a project.
#include <gtest/gtest.h>

#include "FakeHost.h"
#include "usdlive/common/protocol/ServerControl.h"

namespace usdlive::server::projecttest {
namespace {

TEST(ProjectLayers, SeveralOpensShareOneLoad) {
    World world;
    world.join(1);
    world.join(2);
    world.receive(1, ControlMessage(OpenLayer{5, {"a.usda"}, 0}));
    world.receive(2, ControlMessage(OpenLayer{6, {"a.usda"}, 0}));
    EXPECT_EQ(world.host.loading.size(), 1u);
    world.load();
    EXPECT_EQ(world.nextControl<LayerOpened>(1), (LayerOpened{5, {"a.usda"}, 0, 4}));
    EXPECT_EQ(world.nextControl<LayerOpened>(2), (LayerOpened{6, {"a.usda"}, 0, 4}));
    ASSERT_EQ(world.host.snapshots.size(), 2u);
    EXPECT_EQ(world.host.snapshots[0].doc, World::sample());
}

TEST(ProjectLayers, AnImportIsACommitSentAsAStub) {
    World world;
    world.join(1);
    world.join(2);
    world.receive(1, ControlMessage(OpenLayer{5, {"a.usda"}, 0}));
    world.load(true);
    EXPECT_TRUE(world.silent(1));  // not before it is durable
    world.store();
    const auto stub = world.nextFrame<CommitFrame>(2);
    EXPECT_EQ(stub.commit.imported, LayerId{"a.usda"});
    EXPECT_TRUE(stub.commit.edits.empty());
    EXPECT_EQ(stub.hashAfter, world.records[0].hash);
    EXPECT_EQ(world.lastHash, world.records[0].hash);
    EXPECT_EQ(world.records[0].saved->layer, LayerId{"a.usda"});
    EXPECT_EQ(world.nextFrame<CommitFrame>(1), stub);
    EXPECT_EQ(world.nextControl<LayerOpened>(1).revision, 1u);

    const auto stored = decodeFrame(ByteView(*world.records[0].frame).subspan(4));
    const auto& commit = std::get<CommitFrame>(*stored).commit;
    LayerDoc replayed;
    for (const Edit& edit : commit.edits)
        ASSERT_TRUE(replayed.apply(edit.address.path, edit.action));
    EXPECT_EQ(replayed, World::sample());

    // A session that resumes across the commit gets the stub, too, from the store.
    world.restart();
    Hello hello = world.hello(3);
    hello.resume = Hello::Resume{1, 0, {}};
    world.connect(3, hello);
    world.nextControl<Welcome>(3);
    world.answerRead();
    EXPECT_EQ(world.nextFrame<CommitFrame>(3), stub);
}

TEST(ProjectLayers, SE9SessionsAreNotifiedOfChangedLayers) {
    World world;
    world.join(1);
    world.project->setFiles({{{"a.usda"}}, {{"b.usda"}}});
    EXPECT_TRUE(world.silent(1));
    world.project->setFiles({{{"b.usda"}}, {{"late.usda"}}});
    EXPECT_EQ(world.nextControl<usdlive::ProjectLayers>(1),
              (usdlive::ProjectLayers{{{{"b.usda"}}, {{"late.usda"}}}}));
}

TEST(ProjectLayers, SE9TheListComesInPartsBeforeTheWelcomeThenWhatChanges) {
    World world;
    std::vector<LayerFile> files;
    for (int number = 0; number < 50'000; ++number)
        files.push_back({{std::string(150, 'n') + std::to_string(100'000 + number) + ".usda"}});
    world.project->setFiles(files);
    Hello hello = world.hello(1);
    hello.features = {kLayerListFeature};
    world.project->connected(1);
    world.receive(1, ControlMessage(hello));
    std::vector<LayerId> listed;
    int parts = 0;
    for (bool isWelcome = false; !isWelcome;) {
        ASSERT_FALSE(world.silent(1));
        const Bytes frame = world.host.sent[1].front();
        EXPECT_LT(frame.size(), kUpdateBytes + 1'000);
        const auto message =
            decodeServerControl(std::get<ControlFrame>(*decodeFrame(frame)).json).value();
        world.host.sent[1].pop_front();
        if (const auto* list = std::get_if<LayerList>(&message)) {
            ++parts;
            listed.insert(listed.end(), list->added.begin(), list->added.end());
        } else {
            const auto& welcome = std::get<Welcome>(message);
            EXPECT_TRUE(welcome.layers.empty());
            isWelcome = true;
        }
    }
    EXPECT_GT(parts, 1);
    EXPECT_EQ(listed.size(), files.size());
    files.front().layer = {"new.usda"};
    world.project->setFiles(files);
    EXPECT_EQ(world.nextControl<LayerList>(1), (LayerList{{}, {listed.front()}}));
    EXPECT_EQ(world.nextControl<LayerList>(1), (LayerList{{{"new.usda"}}, {}}));
    EXPECT_TRUE(world.silent(1));
}

TEST(ProjectLayers, SE2ALongListOfOpenLayersIsContinuedAfterTheWelcome) {
    World world;
    Hello watching = world.hello(1);
    watching.features = {"states"};
    world.connect(1, watching);
    world.join(2);
    world.host.sent.clear();
    world.receive(2, ControlMessage(KeepLayers{{{"b.usda"}, {"unknown.usda"}}}));
    const auto states = world.nextControl<LayerStates>(1);
    ASSERT_EQ(states.layers.size(), 1u);
    EXPECT_EQ(states.layers[0].layer, LayerId{"b.usda"});
    EXPECT_EQ(states.layers[0].editors, std::vector<UserName>{{"user2"}});
    EXPECT_TRUE(world.silent(2));
}

TEST(ProjectLayers, SE22TheSessionWithTheMostUnansweredRequestsGivesWay) {
    Project::Options options;
    options.sessionRequestBytes = 6'000;
    options.requestBytes = 10'000;
    World world(options);
    for (const SessionId session : {1, 2, 3}) world.join(session);
    std::uint64_t number = 0;
    const auto ask = [&](SessionId session, int times) {
        for (int time = 0; time < times; ++time)
            world.receive(session, ControlMessage(OpenLayer{++number, {"a.usda"}, 0}));
    };
    ask(1, 5);
    ask(2, 14);
    EXPECT_TRUE(world.host.closed.empty());
    ask(3, 13);
    EXPECT_EQ(world.host.closed, std::set<SessionId>{2}) << "it has the most";
    EXPECT_EQ(world.nextControl<ErrorMessage>(2).code, "malformedControl");
    ask(3, 10);
    EXPECT_EQ(world.host.closed, (std::set<SessionId>{2, 3})) << "beyond its own limit";
    world.load();
    EXPECT_EQ(world.nextControl<LayerOpened>(1).layer, LayerId{"a.usda"});
}

TEST(ProjectLayers, SE22TheSessionsOfAUserTakeNoMoreThanItsShare) {
    Project::Options options;
    options.sessionRequestBytes = 6'000;
    options.userRequestBytes = 8'000;
    World world(options);
    for (const SessionId session : {1, 2, 3}) {
        world.connect(session, {}, session == 3 ? "10.0.0.3" : "10.0.0.1");
        world.host.sent[session].clear();
    }
    std::uint64_t number = 0;
    const auto ask = [&](SessionId session, int times) {
        for (int time = 0; time < times; ++time)
            world.receive(session, ControlMessage(OpenLayer{++number, {"a.usda"}, 0}));
    };
    ask(1, 14);
    ask(3, 14);
    EXPECT_TRUE(world.host.closed.empty());
    ask(2, 13);
    EXPECT_EQ(world.host.closed, std::set<SessionId>{1}) << "of this address it has the most";
}

TEST(ProjectLayers, SE22TheSessionsOfAUserHaveNoMoreLayersOpenThanItsShare) {
    Project::Options options;
    options.maxUserLayers = 2;
    World world(options);
    for (const SessionId session : {1, 2, 3}) {
        world.connect(session, {}, session == 3 ? "10.0.0.3" : "10.0.0.1");
        world.host.sent[session].clear();
    }
    const auto open = [&](SessionId session, const char* layer) {
        world.receive(session, ControlMessage(OpenLayer{7, {layer}, 0}));
    };
    open(1, "a.usda");
    open(2, "a.usda");
    open(1, "a.usda");  // again
    open(2, "b.usda");
    EXPECT_EQ(world.nextControl<ErrorMessage>(2).code, "tooManyRequests");
    open(3, "b.usda");
    EXPECT_TRUE(world.silent(3)) << "it is being loaded for another address";
    world.receive(1, ControlMessage(CloseLayer{{"a.usda"}}));
    open(2, "b.usda");
    EXPECT_TRUE(world.silent(2)) << "there is room again";
    open(1, "b.usda");
    EXPECT_EQ(world.nextControl<ErrorMessage>(1).code, "tooManyRequests");
    world.project->disconnected(2);
    open(1, "b.usda");
    EXPECT_TRUE(world.silent(1)) << "the other session has left";
}

TEST(ProjectLayers, SE22AnsweredRequestsTakeNothing) {
    Project::Options options;
    options.sessionRequestBytes = 2'000;
    World world(options);
    world.join(1);
    world.receive(1, ControlMessage(OpenLayer{1, {"a.usda"}, 0}));
    world.load();
    world.submit(1, 1, {create("/C")});
    world.store();
    for (std::uint64_t number = 2; number < 40; number += 4) {
        world.receive(1, ControlMessage(OpenLayer{number, {"a.usda"}, 0}));
        world.receive(1, ControlMessage(OpenLayer{number + 1, {"none.usda"}, 0}));
        world.receive(1, ControlMessage(RequestLog{number + 2, 1, 1}));
        while (!world.host.reading.empty()) world.answerRead();
        world.receive(1, ControlMessage(SaveLayers{number + 3, {{"none.usda"}}, {}}));
        EXPECT_TRUE(world.host.closed.empty()) << number;
    }
}

TEST(ProjectLayers, ASnapshotContainsOnlyDurableCommits) {
    World world;
    world.join(1);
    world.receive(1, ControlMessage(OpenLayer{1, {"a.usda"}, 0}));
    world.load();
    world.host.snapshots.clear();
    world.submit(1, 1, {create("/C")});
    world.join(2);
    world.receive(2, ControlMessage(OpenLayer{1, {"a.usda"}, 0}));
    EXPECT_TRUE(world.silent(2));
    world.store();
    EXPECT_EQ(world.nextFrame<CommitFrame>(2).commit.revision, 1u);
    EXPECT_EQ(world.nextControl<LayerOpened>(2).revision, 1u);
    EXPECT_TRUE(world.host.snapshots.at(0).doc.has("/C"));
}

TEST(ProjectLayers, AnOpenDuringARevertGetsTheReloadedLayer) {
    World world;
    world.join(1);
    world.receive(1, ControlMessage(OpenLayer{1, {"a.usda"}, 0}));
    world.load();
    world.submit(1, 1, {create("/C")});
    world.join(2);
    world.receive(2, ControlMessage(OpenLayer{1, {"a.usda"}, 0}));
    world.host.appending.clear();
    world.project->appendFailed({ErrorCode::StorageFull, "full"}, {});
    world.host.snapshots.clear();
    world.load();
    EXPECT_EQ(world.nextControl<LayerOpened>(2).revision, 0u);
    EXPECT_FALSE(world.host.snapshots.at(0).doc.has("/C"));
}

TEST(ProjectLayers, AnImportThatCouldNotBeStoredIsReportedAndRepeatedOnRequest) {
    World world;
    world.join(1);
    world.receive(1, ControlMessage(OpenLayer{1, {"a.usda"}, 0}));
    world.load(true);
    world.host.appending.clear();
    world.project->appendFailed({ErrorCode::StorageFull, "full"}, {});
    EXPECT_EQ(world.nextControl<ErrorMessage>(1).request, 1u);
    EXPECT_TRUE(world.host.loading.empty());
    world.receive(1, ControlMessage(OpenLayer{2, {"a.usda"}, 0}));
    world.load(true);
    world.store();
    world.nextFrame<CommitFrame>(1);
    EXPECT_EQ(world.nextControl<LayerOpened>(1).request, 2u);
}

TEST(ProjectLayers, WithoutSpaceALayerThatNeedsAnImportCannotBeOpened) {
    World world;
    world.join(1);
    world.project->setSpace(false);
    world.receive(1, ControlMessage(OpenLayer{1, {"a.usda"}, 0}));
    world.receive(1, ControlMessage(OpenLayer{2, {"b.usda"}, 0}));
    world.load(true);
    EXPECT_EQ(world.nextControl<ErrorMessage>(1).code, errorName(ErrorCode::StorageFull));
    world.load(false);
    EXPECT_EQ(world.nextControl<LayerOpened>(1).request, 2u);
}

TEST(ProjectLayers, UnknownAndUnreadableOnesAreAnErrorOfTheRequest) {
    World world;
    world.join(1);
    world.receive(1, ControlMessage(OpenLayer{1, {"x.usda"}, 0}));
    EXPECT_EQ(world.nextControl<ErrorMessage>(1).code, errorName(ErrorCode::LayerNotFound));
    world.receive(1, ControlMessage(OpenLayer{2, {"a.usda"}, 0}));
    world.project->layerLoaded({"a.usda"}, fail(ErrorCode::LayerUnreadable, "parse error"));
    const auto error = world.nextControl<ErrorMessage>(1);
    EXPECT_EQ(error.code, errorName(ErrorCode::LayerUnreadable));
    EXPECT_EQ(error.request, 2u);
    EXPECT_FALSE(error.closing);
}

TEST(ProjectLayers, ALayerOfAnOldRevisionComesFromTheHistory) {
    World world;
    world.join(1);
    world.receive(1, ControlMessage(OpenLayer{1, {"a.usda"}, 0}));
    world.load();
    world.submit(1, 1, {create("/C")});
    world.store();
    world.host.sent.clear();
    world.host.snapshots.clear();
    world.receive(1, ControlMessage(OpenLayer{3, {"a.usda"}, 9}));
    EXPECT_EQ(world.nextControl<ErrorMessage>(1).code, errorName(ErrorCode::FutureRevision));
    world.receive(1, ControlMessage(OpenLayer{4, {"a.usda"}, 1}));
    ASSERT_EQ(world.host.readingHistory.size(), 1u);
    world.project->historyRead(1, 4, World::sample());
    EXPECT_EQ(world.nextControl<LayerOpened>(1), (LayerOpened{4, {"a.usda"}, 1, 4}));
    EXPECT_EQ(world.host.snapshots.size(), 1u);
}

// ---- saving

TEST(ProjectSaves, AllChangedLayersAreSavedOnceDurable) {
    World world;
    world.unsaved = {{"b.usda"}};
    world.start();
    world.join(1);
    world.receive(1, ControlMessage(OpenLayer{1, {"a.usda"}, 0}));
    world.load();
    world.submit(1, 1, {create("/C")});
    world.receive(1, ControlMessage(SaveLayers{9, {}}));
    world.load();
    EXPECT_TRUE(world.host.saves.empty());
    world.store();
    ASSERT_EQ(world.host.saves.size(), 1u);
    ASSERT_EQ(world.host.saves[0].jobs.size(), 2u);
    EXPECT_EQ(world.host.saves[0].jobs[0].revision, 1u);
    world.host.sent.clear();
    world.project->layersSaved(1, 9, {1, {{{"a.usda"}, {}}, {{"b.usda"}, {}}}, {}});
    EXPECT_EQ(world.nextControl<LayersSaved>(1).request, 9u);
    world.receive(1, ControlMessage(SaveLayers{10, {}}));
    EXPECT_EQ(world.nextControl<LayersSaved>(1), (LayersSaved{10, 1, {}, {}}));
}

TEST(ProjectSaves, LayersThatCannotBeSavedAreNamed) {
    World world;
    world.join(1);
    world.receive(1, ControlMessage(SaveLayers{9, {{"a.usda"}, {"b.usda"}, {"x.usda"}}}));
    world.project->layerLoaded({"a.usda"}, fail(ErrorCode::LayerUnreadable, "parse error"));
    world.project->layerLoaded({"b.usda"}, LoadedLayer{World::sample()});
    ASSERT_EQ(world.host.saves.size(), 1u);
    EXPECT_EQ(world.host.saves[0].jobs.size(), 1u);
    world.project->layersSaved(1, 9, {0, {{{"b.usda"}, {}}}, {}});
    const auto saved = world.nextControl<LayersSaved>(1);
    EXPECT_EQ(saved.failed.size(), 2u);
}

// ---- big values

TEST(ProjectBlobs, ArePassedOnAndConfirmed) {
    World world;
    world.join(1);
    const Bytes raw{1, 2, 3};
    const Hash hash = sha256(raw);
    world.receive(1, ControlMessage(RequestBlob{hash, 0}));
    EXPECT_EQ(world.nextControl<ErrorMessage>(1).blob, hash);
    world.receive(1, Frame(BlobFrame{hash, 3, 0, 3, deflate(raw)}));
    EXPECT_EQ(world.host.blobParts.size(), 1u);
    world.host.blobs.insert(hash);
    world.project->blobWritten(1, hash, true);
    EXPECT_EQ(world.nextControl<BlobStored>(1).hash, hash);
    world.receive(1, ControlMessage(RequestBlob{hash, 0}));
    EXPECT_EQ(world.host.blobsSent.size(), 1u);
    // The value is stored already.
    world.receive(1, Frame(BlobFrame{hash, 3, 0, 3, deflate(raw)}));
    EXPECT_EQ(world.nextControl<BlobStored>(1).hash, hash);
    EXPECT_EQ(world.host.blobParts.size(), 1u);
}

// Seed 19977 of the simulation found this: the author was never notified, and kept its transactions
// for ever.
TEST(ProjectBlobs, AreConfirmedToAnUploaderThatWasOvertakenBetweenTwoChunks) {
    World world;
    world.join(1);
    const Bytes first{1, 2}, last{3};
    const Hash hash = sha256(asBytes("\1\2\3"));
    world.receive(1, Frame(BlobFrame{hash, 3, 0, 2, deflate(first)}));
    world.project->blobWritten(1, hash, false);
    world.project->blobWritten(2, hash, true);
    world.receive(1, Frame(BlobFrame{hash, 3, 2, 1, deflate(last)}));
    EXPECT_EQ(world.nextControl<BlobStored>(1).hash, hash);
    EXPECT_EQ(world.host.blobParts.size(), 1u);
}

TEST(ProjectBlobs, InvalidChunksAreRefused) {
    World world;
    world.join(1);
    const Hash hash = sha256(asBytes("x"));
    const auto expectError = [&](BlobFrame part, ErrorCode code) {
        world.receive(1, Frame(std::move(part)));
        EXPECT_EQ(world.nextControl<ErrorMessage>(1).code, errorName(code));
    };
    expectError({hash, 5ull << 30, 0, 3, {}}, ErrorCode::BlobTooLarge);
    expectError({hash, 10, 8, 3, {}}, ErrorCode::BlobMismatch);
    expectError({hash, 10, ~0ull, 3, {}}, ErrorCode::BlobMismatch);
    expectError({hash, 10'000'000, 0, std::uint32_t(kChunkBytes + 1), {}}, ErrorCode::BlobMismatch);
    world.project->blobWritten(1, hash, fail(ErrorCode::BlobMismatch, "hash"));
    EXPECT_EQ(world.nextControl<ErrorMessage>(1).blob, hash);
}

// ---- gestures

TEST(ProjectPreviews, M11ArePassedOnAndShownToLaterSessions) {
    World world;
    world.join(1);
    world.join(2);
    world.receive(1, Frame(PreviewFrame{{}, 7, 0, {set("/A.x", 1)}}));
    world.receive(1, Frame(PreviewFrame{{}, 7, 0, {set("/A.x", 2)}}));
    EXPECT_TRUE(world.silent(1));
    EXPECT_EQ(world.nextFrame<PreviewFrame>(2).author, world.client(1));
    EXPECT_EQ(world.nextFrame<PreviewFrame>(2).edits, (std::vector<Edit>{set("/A.x", 2)}));
    world.connect(3);
    world.nextControl<Welcome>(3);
    EXPECT_EQ(world.nextFrame<PreviewFrame>(3).edits, (std::vector<Edit>{set("/A.x", 2)}));
    EXPECT_TRUE(world.silent(3));
}

TEST(ProjectPreviews, M11AreWithdrawnWhenTheirAuthorLeaves) {
    World world;
    world.join(1);
    world.join(2);
    world.receive(1, Frame(PreviewFrame{{}, 7, 0, {set("/A.x", 1)}}));
    world.next(2);
    world.project->disconnected(1);
    const auto withdrawn = world.nextFrame<PreviewFrame>(2);
    EXPECT_EQ(withdrawn.gesture, 7u);
    EXPECT_TRUE(withdrawn.edits.empty());
    world.connect(3);
    world.nextControl<Welcome>(3);
    EXPECT_TRUE(world.silent(3));
}

// A client that reconnects and has nothing to show any more sends no preview, so it cannot withdraw
// the old one.
TEST(ProjectPreviews, M11AreWithdrawnWhenANewConnectionTakesTheirAuthorsPlace) {
    World world;
    world.join(1);
    world.join(2);
    world.receive(1, Frame(PreviewFrame{{}, 7, 0, {set("/A.x", 1)}}));
    world.next(2);
    Hello hello = world.hello(3);
    hello.client = world.client(1);
    world.connect(3, hello);
    const auto withdrawn = world.nextFrame<PreviewFrame>(2);
    EXPECT_EQ(withdrawn.gesture, 7u);
    EXPECT_TRUE(withdrawn.edits.empty());
    world.project->disconnected(1);
    EXPECT_TRUE(world.silent(2));
}

TEST(ProjectPreviews, B3TheirBigValuesAreInMemoryUntilTheGestureEnds) {
    World world;
    world.join(1);
    world.join(2);
    const Bytes bytes(300'000, 1);
    const Hash hash = sha256(bytes);
    const auto part = [&](std::size_t offset, std::size_t count) {
        const ByteView raw = ByteView(bytes).subspan(offset, count);
        world.receive(
            1, Frame(BlobFrame{hash, bytes.size(), offset, std::uint32_t(count), deflate(raw), 7}));
    };
    const auto answer = [&] {
        world.receive(2, ControlMessage(RequestBlob{hash, 0}));
        std::uint64_t came = 0;
        while (!world.host.sent[2].empty()) {
            const Frame frame = world.next(2);
            if (const auto* blob = std::get_if<BlobFrame>(&frame)) came += blob->rawBytes;
        }
        return came;
    };
    part(0, 200'000);
    EXPECT_EQ(answer(), 0u) << "the value is incomplete";
    part(200'000, 100'000);
    EXPECT_EQ(answer(), bytes.size());
    EXPECT_TRUE(world.host.blobParts.empty()) << "the value is not stored";
    EXPECT_TRUE(world.host.sent[1].empty()) << "there is no answer to send";
    world.receive(1, Frame(PreviewFrame{{}, 7, 0, {}}));
    EXPECT_EQ(answer(), 0u) << "the gesture is over";
    part(0, 200'000);
    part(250'000, 50'000);
    part(200'000, 100'000);
    EXPECT_EQ(answer(), 0u) << "a value with a gap is dropped";
    part(0, 200'000);
    part(200'000, 100'000);
    world.project->disconnected(1);
    EXPECT_EQ(answer(), 0u) << "its author has left";
}

TEST(ProjectPreviews, M11TooManyAtOncePushOutTheOldest) {
    World world;
    world.join(1);
    world.join(2);
    for (std::uint64_t gesture = 1; gesture <= 17; ++gesture)
        world.receive(1, Frame(PreviewFrame{{}, gesture, 0, {set("/A.x", 1)}}));
    std::vector<std::uint64_t> withdrawn;
    while (!world.silent(2)) {
        const auto frame = world.nextFrame<PreviewFrame>(2);
        if (frame.edits.empty()) withdrawn.push_back(frame.gesture);
    }
    EXPECT_EQ(withdrawn, std::vector<std::uint64_t>{1});
}

TEST(ProjectPreviews, SE22ManySessionsOfAUserPushOutItsOwn) {
    World world;
    for (SessionId session = 1; session <= 6; ++session) {
        world.connect(session, {}, session == 6 ? "10.0.0.6" : "10.0.0.1");
        world.host.sent[session].clear();
    }
    const Value large = stringValue(std::string(200'000, 'x'));
    const Edit edit{{"a.usda"}, {"/A.x", {}}, SetField{"default", {}, large, {}}};
    world.receive(6, Frame(PreviewFrame{{}, 1, 0, std::vector(5, edit)}));
    // 1 MB for each of 75 gestures: more than 64 MiB
    for (std::uint64_t gesture = 1; gesture <= 15; ++gesture)
        for (SessionId session = 1; session <= 5; ++session)
            world.receive(session, Frame(PreviewFrame{{}, gesture, 0, std::vector(5, edit)}));
    std::map<std::uint64_t, int> withdrawn;
    while (!world.silent(6)) {
        const auto frame = world.nextFrame<PreviewFrame>(6);
        if (frame.edits.empty()) ++withdrawn[frame.gesture];
    }
    int all = 0;
    for (const auto& [gesture, count] : withdrawn) all += count;
    EXPECT_GE(all, 5);
    EXPECT_LE(all, 12);
    EXPECT_LE(withdrawn.rbegin()->first, 3u) << "the oldest gestures of each session";
    world.host.sent[1].clear();
    world.connect(7);
    bool has = false;
    while (!world.silent(7)) {
        const Frame frame = world.next(7);
        const auto* preview = std::get_if<PreviewFrame>(&frame);
        has = has || (preview && preview->author == world.client(6));
    }
    EXPECT_TRUE(has) << "that of another address stays";
}

TEST(ProjectPreviews, SE22APreviewThatIsPushedOutAtOnceIsNotShown) {
    World world;
    const Value large = stringValue(std::string(200'000, 'x'));
    const Edit edit{{"a.usda"}, {"/A.x", {}}, SetField{"default", {}, large, {}}};
    constexpr SessionId kWatching = 200;
    world.connect(kWatching, {}, "10.0.0.6");
    // Sessions of one address with 0.8 MB each, up to its limit. The last one has the most.
    constexpr SessionId kLast = 84;
    constexpr std::uint64_t kGesture = 99;
    for (SessionId session = 1; session <= kLast; ++session) {
        world.connect(session, {}, "10.0.0.1");
        world.receive(session, Frame(PreviewFrame{{},
                                                  session == kLast ? kGesture : 1,
                                                  0,
                                                  std::vector(session == kLast ? 5 : 4, edit)}));
    }
    int shown = 0;
    bool isShown = false;
    while (!world.silent(kWatching)) {
        const Frame frame = world.next(kWatching);
        const auto* preview = std::get_if<PreviewFrame>(&frame);
        if (!preview) continue;
        if (preview->gesture == kGesture)
            isShown = !preview->edits.empty();
        else
            shown += preview->edits.empty() ? -1 : 1;
    }
    EXPECT_FALSE(isShown) << "nothing would withdraw it";
    EXPECT_EQ(shown, int(kLast) - 1) << "those of the others stay";
}

TEST(ProjectPreviews, PreviewsOfNoGestureAndTooLargeOnes) {
    World world;
    world.join(1);
    world.join(2);
    const Value large = stringValue(std::string(200'000, 'x'));
    const Edit edit{{"a.usda"}, {"/A.x", {}}, SetField{"default", {}, large, {}}};
    world.receive(1, Frame(PreviewFrame{{}, 1, 0, std::vector(8, edit)}));
    EXPECT_FALSE(world.nextControl<ErrorMessage>(1).closing);
    EXPECT_TRUE(world.silent(2));
    world.receive(1, Frame(PreviewFrame{{}, 0, 0, {set("/A.x", 1)}}));
    EXPECT_TRUE(world.nextControl<ErrorMessage>(1).closing);
}

TEST(ProjectPreviews, M11EndWithTheirTransaction) {
    World world;
    world.join(1);
    world.join(2);
    world.receive(1, ControlMessage(OpenLayer{1, {"a.usda"}, 0}));
    world.load();
    world.receive(1, Frame(PreviewFrame{{}, 7, 0, {set("/A.x", 1)}}));
    world.next(2);
    world.submit(1, 1, {set("/A.x", 3)}, 0, 7);
    world.store();
    EXPECT_EQ(world.nextFrame<CommitFrame>(2).commit.gesture, 7u);
    world.connect(3);
    world.nextControl<Welcome>(3);
    EXPECT_TRUE(world.silent(3));
    // A refused preview leaves nothing behind.
    world.receive(1, Frame(PreviewFrame{{}, 8, 1, {set("/A.x", 1)}}));
    world.next(2);
    world.submit(1, 2, {move("/A", "/", "B")}, 1, 8);
    EXPECT_TRUE(world.nextFrame<PreviewFrame>(2).edits.empty());
}

Project::Options snapshotsAfter(std::size_t bytes) {
    Project::Options options;
    options.leastReplay = bytes;
    options.snapshotIntervalMs = 0;
    return options;
}

TEST(ProjectLayers, ASnapshotOfTheDurableContentIsTakenWhenDue) {
    World world(snapshotsAfter(1'000));
    world.join(1);
    world.receive(1, ControlMessage(OpenLayer{1, {"a.usda"}, 0}));
    world.load();
    const LayerId layer{"a.usda"};
    Revision revision = 0;
    const auto edit = [&] {
        ++revision;
        world.submit(1, revision, {set("/A.x", double(revision))}, revision - 1);
    };
    while (world.host.appending.size() < 10) edit();
    const LayerDoc ahead = *world.project->layer(layer);
    EXPECT_TRUE(world.host.kept.empty()) << "not durable yet";
    world.store();
    ASSERT_EQ(world.host.kept.size(), 1u) << "one at a time, as long as it is on its way";
    const auto& [at, doc] = world.host.kept.front();
    EXPECT_LT(at, revision);
    EXPECT_EQ(*doc.field("/A.x", "default"), FieldValue(doubleValue(double(at))));
    EXPECT_EQ(*ahead.field("/A.x", "default"), FieldValue(doubleValue(double(revision))));

    // The snapshot was that large, so the next is not due for long.
    world.project->snapshotKept(layer, 100'000);
    for (int i = 0; i < 100; ++i) edit();
    world.store();
    EXPECT_EQ(world.host.kept.size(), 1u);
    for (int i = 0; i < 100; ++i) edit();
    world.store();
    EXPECT_EQ(world.host.kept.size(), 2u) << "commits of some 530 each";
    // After a failure, another is due when the same amount was committed again.
    world.project->snapshotKept(layer, fail(ErrorCode::StorageFull, "full"));
    for (int i = 0; i < 200; ++i) edit();
    world.store();
    EXPECT_EQ(world.host.kept.size(), 3u);
}

TEST(ProjectLayers, ASnapshotIsTakenSomeTimeAfterTheOneBefore) {
    auto options = snapshotsAfter(0);
    options.snapshotIntervalMs = 10'000;
    World world(options);
    world.join(1);
    world.receive(1, ControlMessage(OpenLayer{1, {"a.usda"}, 0}));
    world.load();
    Revision revision = 0;
    const auto edit = [&] {
        ++revision;
        world.submit(1, revision, {set("/A.x", double(revision))}, revision - 1);
        world.store();
        if (!world.host.kept.empty()) world.project->snapshotKept({"a.usda"}, 100);
        return world.host.kept.size();
    };
    EXPECT_EQ(edit(), 1u);
    EXPECT_EQ(edit(), 1u);
    world.host.nowMs += 9'999;
    EXPECT_EQ(edit(), 1u);
    world.host.nowMs += 1;
    EXPECT_EQ(edit(), 2u);
    world.host.jumpMs = -3'600'000;  // the clock of the machine is set back
    EXPECT_EQ(edit(), 2u);
    world.host.nowMs += 10'000;
    EXPECT_EQ(edit(), 3u);
}

TEST(ProjectLayers, ALayerThatTookLongToLoadIsKeptAtOnce) {
    for (const std::size_t cost : {2'499, 2'500}) {
        World world(snapshotsAfter(1'000));
        world.join(1);
        world.receive(1, ControlMessage(OpenLayer{1, {"a.usda"}, 0}));
        LoadedLayer loaded{World::sample()};
        loaded.replayed = {1'500, cost};
        world.project->layerLoaded({"a.usda"}, loaded);
        EXPECT_EQ(world.host.kept.size(), cost == 2'500 ? 1u : 0u);
    }
}

TEST(ProjectLayers, NoSnapshotIsTakenOfLostCommits) {
    World world(snapshotsAfter(0));
    world.join(1);
    world.receive(1, ControlMessage(OpenLayer{1, {"a.usda"}, 0}));
    world.load();
    for (std::uint64_t number = 1; number <= 5; ++number)
        world.submit(1, number, {set("/A.x", double(number))});
    world.host.appending.clear();
    world.project->appendFailed({ErrorCode::StorageFull, "full"}, {});
    world.load();
    world.submit(1, 6, {set("/A.x", 6)});
    world.store();
    ASSERT_EQ(world.host.kept.size(), 1u) << "a finished snapshot does not count as pending";
    EXPECT_EQ(*world.host.kept[0].second.field("/A.x", "default"), FieldValue(doubleValue(6)));
}

}  // namespace
}  // namespace usdlive::server::projecttest
