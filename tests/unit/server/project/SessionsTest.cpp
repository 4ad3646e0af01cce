// Tests sessions of a project: hello, resuming, and the log.
#include <gtest/gtest.h>

#include "FakeHost.h"
#include "usdlive/common/core/ClientSecret.h"

namespace usdlive::server::projecttest {
namespace {

TEST(ProjectSessions, HelloIsAnsweredByAWelcome) {
    World world;
    world.connect(1);
    const auto welcome = world.nextControl<Welcome>(1);
    EXPECT_EQ(welcome.protocol, kProtocolVersion);
    EXPECT_EQ(welcome.epoch, 1u);
    EXPECT_EQ(welcome.revision, 0u);
    EXPECT_FALSE(welcome.resumed);
    EXPECT_EQ(welcome.layers, (std::vector<LayerInfo>{{{"a.usda"}}, {{"b.usda"}}}));
    EXPECT_EQ(welcome.maxFrameBytes, kMaxFrameBytes);
    EXPECT_EQ(world.project->sessionCount(), 1u);
}

void expectClosed(World& world, SessionId session, ErrorCode code) {
    const auto error = world.nextControl<ErrorMessage>(session);
    EXPECT_EQ(error.code, errorName(code));
    EXPECT_TRUE(error.closing);
    EXPECT_TRUE(world.host.closed.contains(session));
    world.receive(session, ControlMessage(world.hello(session)));
    EXPECT_TRUE(world.silent(session));
}

TEST(ProjectSessions, InvalidMessagesEndTheSessionWithAnError) {
    World world;
    world.project->connected(1);
    world.project->received(1, asBytes("no frame"));
    expectClosed(world, 1, ErrorCode::FrameTooLarge);

    world.project->connected(2);
    world.project->received(2, Bytes{4, 0, 0, 0, 1, 2, 3, 4});
    expectClosed(world, 2, ErrorCode::MalformedFrame);

    world.project->connected(3);
    world.receive(3, Frame(ControlFrame{"{}"}));
    expectClosed(world, 3, ErrorCode::MalformedControl);
}

TEST(ProjectSessions, NothingComesBeforeTheHello) {
    World world;
    world.project->connected(1);
    world.submit(1, 1, {create("/C")});
    expectClosed(world, 1, ErrorCode::NotGreeted);
    world.project->connected(2);
    world.receive(2, ControlMessage(OpenLayer{1, {"a.usda"}, 0}));
    expectClosed(world, 2, ErrorCode::NotGreeted);
}

TEST(ProjectSessions, ASecondHelloCloses) {
    World world;
    world.join(1);
    world.receive(1, ControlMessage(world.hello(1)));
    expectClosed(world, 1, ErrorCode::SecondHello);
}

// Others know the id, and repeat it without the secret, or with one of their own.
TEST(ProjectSessions, ID5OnlyTheSecretProvesAClientsId) {
    World world;
    const Hash secret = sha256(asBytes("mine"));
    const auto hello = [&](std::optional<Hash> given) {
        Hello owner = world.hello(1);
        owner.client = clientIdOf(secret);
        owner.secret = std::move(given);
        return owner;
    };
    world.connect(1, hello(secret));
    (void)world.nextControl<Welcome>(1);
    world.connect(2, hello(std::nullopt));
    expectClosed(world, 2, ErrorCode::InvalidArgument);
    world.connect(3, hello(sha256(asBytes("theirs"))));
    expectClosed(world, 3, ErrorCode::InvalidArgument);
    EXPECT_FALSE(world.host.closed.contains(1)) << "its owner is not disturbed";
    world.connect(4, hello(secret));
    EXPECT_EQ(world.nextControl<Welcome>(4).epoch, 1u);
    EXPECT_TRUE(world.host.closed.contains(1)) << "the owner replaces its own session";
}

TEST(ProjectSessions, VersionsAreNegotiated) {
    World world;
    Hello newer = world.hello(1);
    newer.protocol = kProtocolVersion + 1;
    world.connect(1, newer);
    EXPECT_EQ(world.nextControl<Welcome>(1).protocol, kProtocolVersion);

    Hello tooNew = world.hello(2);
    tooNew.protocol = tooNew.oldestProtocol = kProtocolVersion + 1;
    world.connect(2, tooNew);
    expectClosed(world, 2, ErrorCode::UnsupportedProtocol);
}

TEST(ProjectSessions, FramesOfTheServerAreRefused) {
    World world;
    world.join(1);
    world.receive(1, Frame(RefusalFrame{1, 0, {ErrorCode::Internal, "x"}}));
    expectClosed(world, 1, ErrorCode::UnknownFrame);
    world.join(2);
    world.receive(2, ControlMessage(LogEnd{1}));
    expectClosed(world, 2, ErrorCode::MalformedControl);
}

TEST(ProjectSessions, TooManySessionsAreRefusedWithTheReason) {
    Project::Options options;
    options.maxSessions = 1;
    World world(options);
    world.project->connected(4);  // takes no seat, because it says nothing
    world.join(1);
    world.connect(2);
    expectClosed(world, 2, ErrorCode::TooManySessions);
    EXPECT_EQ(world.project->sessionCount(), 1u);
    world.project->disconnected(2);
    world.project->disconnected(1);
    world.connect(3);
    EXPECT_NO_THROW(world.nextControl<Welcome>(3));
}

TEST(ProjectSessions, FR20AControlMessageOfAClientIsBounded) {
    World world;
    world.join(1);
    std::string values = R"({"type":"closeLayer","layer":"a.usda","more":[0)";
    for (int count = 0; count < 131'072; ++count) values += ",0";
    world.receive(1, Frame(ControlFrame{values + "]}"}));
    expectClosed(world, 1, ErrorCode::MalformedControl);
    world.join(2);
    world.receive(2, Frame(ControlFrame{R"({"type":"closeLayer","layer":"a.usda","more":")" +
                                        std::string(4 << 20, 'x') + "\"}"}));
    expectClosed(world, 2, ErrorCode::MalformedControl);
}

TEST(ProjectSessions, LayerNamesThatLeadOutEndTheSessionWithAnError) {
    World world;
    world.join(1);
    world.receive(1, Frame(ControlFrame{
                         R"({"type":"openLayer","request":1,"layer":"../x.usda","revision":0})"}));
    expectClosed(world, 1, ErrorCode::InvalidLayerName);
}

// ---- resuming

class ProjectResume : public ::testing::Test {
protected:
    void SetUp() override {
        world.join(1);
        world.receive(1, ControlMessage(OpenLayer{1, {"a.usda"}, 0}));
        world.load();
        for (std::uint64_t number = 1; number <= 4; ++number)
            world.submit(1, number, {create("/P" + std::to_string(number))}, number - 1);
        world.store();
        for (const StoredCommit& commit : world.host.log) hashes.push_back(commit.hash);
    }
    Hello resuming(Revision revision) {
        Hello hello = world.hello(2);
        hello.resume = Hello::Resume{1, revision, hashes[revision]};
        return hello;
    }
    void expectCommits(Revision from, Revision to) {
        for (Revision revision = from; revision <= to; ++revision)
            EXPECT_EQ(world.nextFrame<CommitFrame>(2).commit.revision, revision);
        EXPECT_TRUE(world.silent(2));
    }

    World world;
    std::vector<Hash> hashes{Hash{}};
};

TEST_F(ProjectResume, SendsTheMissedCommits) {
    world.connect(2, resuming(2));
    const auto welcome = world.nextControl<Welcome>(2);
    EXPECT_TRUE(welcome.resumed);
    EXPECT_EQ(welcome.revision, 4u);
    EXPECT_EQ(welcome.hash, hashes[4]);
    expectCommits(3, 4);
}

TEST_F(ProjectResume, ReadsFromTheStoreAfterARestart) {
    world.restart();
    world.connect(2, resuming(1));
    EXPECT_TRUE(world.silent(2));  // the hash is being checked
    world.receive(2, ControlMessage(OpenLayer{7, {"zzz.usda"}, 0}));
    world.answerRead();
    EXPECT_TRUE(world.nextControl<Welcome>(2).resumed);
    EXPECT_EQ(world.nextControl<ErrorMessage>(2).request, 7u);  // it waited for the welcome
    world.answerRead();
    expectCommits(2, 4);
}

TEST_F(ProjectResume, AnotherHistoryIsReportedAndJoinedAgain) {
    Hello hello = resuming(2);
    hello.resume->hash = hashes[3];
    world.connect(2, hello);
    const auto error = world.nextControl<ErrorMessage>(2);
    EXPECT_EQ(error.code, errorName(ErrorCode::HistoryDiverged));
    EXPECT_FALSE(error.closing);
    EXPECT_FALSE(world.nextControl<Welcome>(2).resumed);
    EXPECT_TRUE(world.silent(2));
}

TEST_F(ProjectResume, AMissingRevisionIsReportedAndJoinedAgain) {
    Hello hello = resuming(4);
    hello.resume->revision = 9;
    world.connect(2, hello);
    EXPECT_EQ(world.nextControl<ErrorMessage>(2).code, errorName(ErrorCode::FutureRevision));
    EXPECT_FALSE(world.nextControl<Welcome>(2).resumed);
}

TEST_F(ProjectResume, ALaterEpochIsAnotherHistory) {
    Hello hello = resuming(4);
    hello.resume->epoch = 2;
    world.connect(2, hello);
    EXPECT_EQ(world.nextControl<ErrorMessage>(2).code, errorName(ErrorCode::HistoryDiverged));
}

TEST_F(ProjectResume, ID2AnotherStoreIsAnotherHistory) {
    world.identity = {"mine"};
    world.restart();
    Hello hello = resuming(4);
    hello.resume->store = StoreId{"another"};
    world.connect(2, hello);
    EXPECT_EQ(world.nextControl<ErrorMessage>(2).code, errorName(ErrorCode::HistoryDiverged));
    const auto welcome = world.nextControl<Welcome>(2);
    EXPECT_FALSE(welcome.resumed);
    EXPECT_EQ(welcome.store, StoreId{"mine"});
}

// A client that cannot resume for another reason is still told that the histories differ.
TEST_F(ProjectResume, ID2TheHashIsComparedFirst) {
    world.host.forgotten = 3;
    Hello hello = resuming(2);
    hello.resume->hash = hashes[3];
    world.connect(2, hello);
    EXPECT_EQ(world.nextControl<ErrorMessage>(2).code, errorName(ErrorCode::HistoryDiverged));
}

TEST_F(ProjectResume, M14OnlyUnansweredWorkMayBeForgotten) {
    world.host.forgotten = 3;
    Hello hello = resuming(4);
    hello.resume->unansweredSince = 2;
    world.connect(2, hello);
    EXPECT_EQ(world.nextControl<ErrorMessage>(2).code, errorName(ErrorCode::ClientForgotten));
}

TEST_F(ProjectResume, M14AClientThatMayBeForgottenIsNotified) {
    world.host.forgotten = 3;
    world.connect(2, resuming(2));
    EXPECT_EQ(world.nextControl<ErrorMessage>(2).code, errorName(ErrorCode::ClientForgotten));
    EXPECT_FALSE(world.nextControl<Welcome>(2).resumed);
    world.project->disconnected(2);
    world.host.sent.clear();
    // All commits of forgotten clients are at revisions that this client has received.
    world.connect(2, resuming(3));
    EXPECT_TRUE(world.nextControl<Welcome>(2).resumed);
    world.project->disconnected(2);
    world.host.sent.clear();
    // The store knows this client.
    world.restart();
    Hello hello = resuming(1);
    hello.client = world.client(1);
    world.connect(2, hello);
    world.answerRead();
    EXPECT_TRUE(world.nextControl<Welcome>(2).resumed);
    // This is not known while the store is closed.
    world.project->storeClosed();
    world.connect(3, resuming(1));
    EXPECT_EQ(world.nextControl<ErrorMessage>(3).code, errorName(ErrorCode::StorageFailed));
    EXPECT_TRUE(world.host.closed.contains(3));
}

// A new connection replaces an abandoned one; the store's answer for the old one is used for the
// new one, too.
TEST_F(ProjectResume, M14IsReportedAgainIfTheClientDidNotReceiveIt) {
    world.host.forgotten = 3;
    world.connect(2, resuming(2));
    world.connect(3, resuming(2));
    EXPECT_EQ(world.nextControl<ErrorMessage>(3).code, errorName(ErrorCode::ClientForgotten));
    EXPECT_FALSE(world.nextControl<Welcome>(3).resumed);
}

TEST_F(ProjectResume, M14HoldsWhileTheStoreIsClosed) {
    world.project->clientsForgotten(3);
    world.project->storeClosed();
    world.connect(2, resuming(2));
    EXPECT_EQ(world.nextControl<ErrorMessage>(2).code, errorName(ErrorCode::StorageFailed));
    EXPECT_TRUE(world.host.closed.contains(2));
    world.connect(3, resuming(3));
    EXPECT_TRUE(world.nextControl<Welcome>(3).resumed);
}

TEST_F(ProjectResume, WaitsForTheStoresAnswerAboutTheClient) {
    world.answers = false;
    world.connect(2, resuming(4));
    EXPECT_TRUE(world.silent(2));
    world.submit(2, 1, {create("/Q")}, 4);
    EXPECT_TRUE(world.host.appending.empty());
    world.answerQuestions();
    EXPECT_TRUE(world.nextControl<Welcome>(2).resumed);
    EXPECT_EQ(world.host.appending.size(), 1u);
}

// Meanwhile it is not known whether a transaction is committed already.
TEST_F(ProjectResume, AClientThatCannotBeLookedUpConnectsAgain) {
    world.answers = false;
    world.join(2);
    world.submit(2, 1, {create("/Q")}, 4);
    world.project->clientRead(world.client(2), fail(ErrorCode::StorageFailed, "cannot be read"));
    EXPECT_EQ(world.nextControl<ErrorMessage>(2).code, errorName(ErrorCode::StorageFailed));
    EXPECT_TRUE(world.host.closed.contains(2));
    EXPECT_TRUE(world.host.appending.empty());
    world.project->disconnected(2);
    world.join(3);
    world.answerQuestions();
    world.submit(3, 1, {create("/Q")}, 4);
    EXPECT_EQ(world.host.appending.size(), 1u);
}

TEST_F(ProjectResume, AClientThatCannotBeLookedUpMayRead) {
    world.answers = false;
    world.join(2);
    world.project->clientRead(world.client(2), fail(ErrorCode::StorageFailed, "cannot be read"));
    EXPECT_TRUE(world.silent(2));
    world.submit(2, 1, {create("/Q")}, 4);
    EXPECT_TRUE(world.host.appending.empty());
    world.answerQuestions();
    EXPECT_EQ(world.host.appending.size(), 1u);
}

// Otherwise its numbers before those on their way would be executed a second time.
TEST_F(ProjectResume, M14AClientWithCommitsOnTheirWayIsNotForgotten) {
    world.submit(1, 5, {create("/P5")}, 4);
    world.project->disconnected(1);
    EXPECT_TRUE(world.project->activeClients().contains(world.client(1)));
    world.store();
    EXPECT_FALSE(world.project->activeClients().contains(world.client(1)));
}

TEST_F(ProjectResume, WaitsWhileTheConnectionIsCongested) {
    world.host.congestedSessions.insert(2);
    world.connect(2, resuming(0));
    EXPECT_TRUE(world.nextControl<Welcome>(2).resumed);
    EXPECT_TRUE(world.silent(2));
    world.submit(1, 5, {create("/P5")}, 4);
    world.store();
    EXPECT_TRUE(world.silent(2));
    world.host.congestedSessions.clear();
    world.project->drained(2);
    expectCommits(1, 5);
    world.submit(1, 6, {create("/P6")}, 5);
    world.store();
    expectCommits(6, 6);
}

TEST_F(ProjectResume, SE5ARefusalWaitsForTheResumedCommits) {
    world.restart();
    Hello hello = world.hello(2);
    hello.client = world.client(1);
    hello.resume = Hello::Resume{1, 2, hashes[2]};
    world.connect(2, hello);
    world.receive(2, Frame(SubmitFrame{{{world.client(1), 9}, 2, 0, {create("/C", {"x.usda"})}}}));
    world.answerRead();  // the hash
    world.nextControl<Welcome>(2);
    EXPECT_TRUE(world.silent(2));
    world.answerRead();
    EXPECT_EQ(world.nextFrame<CommitFrame>(2).commit.revision, 3u);
    EXPECT_EQ(world.nextFrame<CommitFrame>(2).commit.revision, 4u);
    EXPECT_EQ(world.nextFrame<RefusalFrame>(2).sequence, 9u);
}

TEST_F(ProjectResume, OlderCommitsAreReadFromTheStore) {
    world.options.recentCommitBytes = 1'000;
    world.restart();
    world.join(1);
    world.submit(1, 5, {create("/P5")}, 4);
    world.load();
    for (std::uint64_t number = 6; number <= 20; ++number)
        world.submit(1, number, {create("/P" + std::to_string(number))}, number - 1);
    world.store();
    world.connect(2, resuming(1));
    world.answerRead();
    world.nextControl<Welcome>(2);
    world.answerRead();
    expectCommits(2, 20);
}

TEST_F(ProjectResume, AStoreThatCannotBeReadEndsTheSession) {
    world.restart();
    world.connect(2, resuming(1));
    world.answerRead();
    world.nextControl<Welcome>(2);
    world.host.reading.clear();
    world.project->commitsRead(2, fail(ErrorCode::StorageCorrupt, "revision 2"));
    EXPECT_TRUE(world.nextControl<ErrorMessage>(2).closing);
}

// ---- the log

TEST_F(ProjectResume, TheLogIsSentBetweenItsMarksAndLiveCommitsAfterIt) {
    world.restart();
    world.join(2);
    world.receive(2, ControlMessage(RequestLog{5, 2, 0}));
    EXPECT_EQ(world.nextControl<LogBegin>(2).request, 5u);
    world.join(1);
    world.submit(1, 5, {create("/P5")}, 4);
    world.load();
    world.store();
    EXPECT_TRUE(world.silent(2));
    world.answerRead();
    for (Revision revision = 2; revision <= 4; ++revision)
        EXPECT_EQ(world.nextFrame<CommitFrame>(2).commit.revision, revision);
    EXPECT_EQ(world.nextControl<LogEnd>(2).request, 5u);
    expectCommits(5, 5);
}

TEST_F(ProjectResume, TheLogOfTheFutureIsAnError) {
    world.join(2);
    world.receive(2, ControlMessage(RequestLog{5, 2, 9}));
    const auto error = world.nextControl<ErrorMessage>(2);
    EXPECT_EQ(error.code, errorName(ErrorCode::FutureRevision));
    EXPECT_EQ(error.request, 5u);
}

}  // namespace
}  // namespace usdlive::server::projecttest
