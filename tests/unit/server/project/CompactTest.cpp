// Tests compact frames and acceptances in the project (FR9-FR11).
#include <gtest/gtest.h>

#include "FakeHost.h"
#include "usdlive/common/core/ByteStream.h"
#include "usdlive/common/protocol/CompactFrame.h"

namespace usdlive::server::projecttest {
namespace {

class ProjectCompact : public ::testing::Test {
protected:
    static constexpr SessionId kAuthor = 1, kOther = 2, kOlder = 3;

    void SetUp() override {
        join(kAuthor);
        join(kOther);
        world.join(kOlder);
        submit(kAuthor, 1, {set("/A.x", 1)});
        world.load();
        world.store();
        for (const SessionId session : {kAuthor, kOther}) (void)take(session);
        (void)world.next(kOlder);
    }
    Welcome join(SessionId session) {
        Hello hello = world.hello(session);
        hello.features = {kCompactFeature};
        world.connect(session, hello);
        readers[session] = {};
        numbers[session] = {};
        return world.nextControl<Welcome>(session);
    }
    void submit(SessionId session, std::uint64_t sequence, std::vector<Edit> edits,
                std::uint64_t gesture = 0) {
        send(session,
             Transaction{{{}, sequence}, world.host.log.size(), gesture, std::move(edits)});
    }
    void send(SessionId session, const auto& content) {
        const auto frame = encodeCompact(content, numbers[session]);
        KnownNames unknown;
        if (const SharedBytes names = unknown.introduce(*frame))
            world.project->received(session, *names);
        world.project->received(session, *frame->bytes);
        world.answerQuestions();
    }
    /// Takes the next compact frame, and the names before it.
    CompactContent take(SessionId session) {
        for (;;) {
            auto& frames = world.host.sent[session];
            if (frames.empty()) throw std::runtime_error("nothing was sent");
            const Bytes frame = std::move(frames.front());
            frames.pop_front();
            EXPECT_TRUE(isCompact(frame));
            auto content = readers[session].read(frame);
            if (!content) throw std::runtime_error(content.error().message);
            if (!std::holds_alternative<std::monostate>(*content)) return std::move(*content);
        }
    }

    World world;
    std::map<SessionId, CompactReader> readers;
    std::map<SessionId, NameNumbers> numbers;
};

TEST_F(ProjectCompact, FR11TheAuthorGetsAnAcceptanceAndTheOthersTheCommit) {
    submit(kAuthor, 2, {set("/A.x", 2)});
    EXPECT_TRUE(world.silent(kAuthor)) << "not durable";
    world.store();
    const auto accepted = std::get<Acceptance>(take(kAuthor));
    const auto compact = std::get<CompactCommit>(take(kOther));
    const Commit stored = world.nextFrame<CommitFrame>(kOlder).commit;
    EXPECT_EQ(accepted.revision, 2u);
    EXPECT_EQ(accepted.sequence, 2u);
    EXPECT_EQ(accepted.timeMs, stored.timeMs);
    EXPECT_EQ(accepted.hashAfter, world.lastHash);
    EXPECT_TRUE(beginsLike(accepted.previous, stored.previous));
    EXPECT_EQ(compact.hashAfter, world.lastHash);
    EXPECT_TRUE(beginsLike(compact.commit.previous, stored.previous));
    Commit same = compact.commit;
    same.previous = stored.previous;
    EXPECT_EQ(same, stored);
}

TEST_F(ProjectCompact, FR11TheAuthorGetsWhatItDidNotSend) {
    submit(kOther, 1, {move("/A", "/", "C")});
    submit(kAuthor, 2, {set("/A.x", 2)});  // M3: it was moved
    submit(kOther, 2, {erase("/A")});
    submit(kAuthor, 3, {set("/A.x", 2), create("/D")});  // M4: dropped
    world.store();
    (void)take(kAuthor);
    const auto moved = std::get<CompactCommit>(take(kAuthor)).commit;
    EXPECT_EQ(moved.id.sequence, 2u);
    EXPECT_EQ(moved.edits.at(0).address.path, "/C.x");
    EXPECT_EQ(world.nextFrame<CommitFrame>(kAuthor).commit.firstUnseen, 2u) << "M17: not compact";
    const auto dropped = std::get<CompactCommit>(take(kAuthor)).commit;
    EXPECT_EQ(dropped.id.sequence, 3u);
    EXPECT_EQ(dropped.dropped.size(), 1u);
}

TEST_F(ProjectCompact, FR11AnotherSessionOfTheAuthorGetsTheCommit) {
    submit(kAuthor, 2, {set("/A.x", 2)});
    Hello again = world.hello(kAuthor);
    again.features = {kCompactFeature};
    again.resume = Hello::Resume{world.epoch, 1, world.host.log.back().hash};
    world.project->disconnected(kAuthor);
    world.connect(7, again);
    readers[7] = {};
    (void)world.nextControl<Welcome>(7);
    // It was sent again, perhaps with other addresses.
    world.project->received(
        7, *encodeCompact(Transaction{{{}, 2}, 1, 0, {set("/A.x", 2)}}, numbers[7])->bytes);
    world.answerQuestions();
    world.store();
    EXPECT_EQ(std::get<CompactCommit>(take(7)).commit.id, (TransactionId{world.client(1), 2}));
    EXPECT_EQ(world.nextControl<AlreadyCommitted>(7).sequence, 2u);
}

TEST_F(ProjectCompact, FR11ARevisionThatIsGivenAgainIsNotAccepted) {
    submit(kAuthor, 2, {set("/A.x", 2)});
    world.host.appending.clear();
    world.project->appendFailed({ErrorCode::StorageFailed, "sync"},
                                {1, world.host.log.back().hash, 2});
    EXPECT_EQ(world.nextFrame<RefusalFrame>(kAuthor).sequence, 2u);
    world.load();
    submit(kOther, 1, {set("/A.x", 3)});
    world.store();
    EXPECT_EQ(std::get<CompactCommit>(take(kAuthor)).commit.revision, 2u);
    EXPECT_EQ(std::get<Acceptance>(take(kOther)).revision, 2u);
}

TEST_F(ProjectCompact, FR11ALargeTransactionIsAcceptedToo) {
    std::vector<Edit> edits;
    for (int prim = 0; prim < 5'000; ++prim) edits.push_back(create("/P" + std::to_string(prim)));
    world.submit(kAuthor, 2, edits, 1);
    world.store();
    EXPECT_EQ(std::get<Acceptance>(take(kAuthor)).revision, 2u);
    EXPECT_EQ(world.nextFrame<CommitFrame>(kOther).commit.edits.size(), 5'000u) << "not compact";
    submit(kAuthor, 3, {set("/A.x", 3)});
    world.store();
    EXPECT_EQ(std::get<Acceptance>(take(kAuthor)).revision, 3u);
}

TEST_F(ProjectCompact, FR11ACommitInPartsIsAccepted) {
    world.options.wholeCommitBytes = 1'000;
    world.options.partBytes = 500;
    world.restart();
    join(kAuthor);
    join(kOther);
    std::vector<Edit> edits;
    for (int prim = 0; prim < 60; ++prim) edits.push_back(create("/P" + std::to_string(prim)));
    submit(kAuthor, 2, edits);
    world.load();
    world.store();
    EXPECT_EQ(std::get<Acceptance>(take(kAuthor)).revision, 2u);
    EXPECT_TRUE(world.silent(kAuthor));
    EXPECT_TRUE(world.nextFrame<CommitFrame>(kOther).more);
    submit(kAuthor, 3, {set("/A.x", 3)});
    world.store();
    EXPECT_EQ(std::get<Acceptance>(take(kAuthor)).revision, 3u);
}

TEST_F(ProjectCompact, FR9ASessionThatFallsBehindGetsStoredCommits) {
    world.host.congestedSessions.insert(kOther);
    for (std::uint64_t sequence = 2; sequence < 5; ++sequence)
        submit(kAuthor, sequence, {set("/A.x", double(sequence))});
    world.store();
    EXPECT_TRUE(world.silent(kOther));
    world.host.congestedSessions.clear();
    world.project->drained(kOther);
    for (Revision revision = 2; revision < 5; ++revision)
        EXPECT_EQ(world.nextFrame<CommitFrame>(kOther).commit.revision, revision);
    submit(kAuthor, 5, {set("/A.x", 5)});
    world.store();
    EXPECT_EQ(std::get<CompactCommit>(take(kOther)).commit.revision, 5u);
}

TEST_F(ProjectCompact, M11PreviewsAreCompact) {
    for (int time = 0; time < 3; ++time) {
        send(kAuthor, PreviewFrame{{}, 7, 1, {set("/A.x", time)}});
        const PreviewFrame expected{world.client(kAuthor), 7, 1, {set("/A.x", time)}};
        EXPECT_EQ(std::get<PreviewFrame>(take(kOther)), expected);
        EXPECT_EQ(world.nextFrame<PreviewFrame>(kOlder), expected);
    }
    EXPECT_TRUE(world.silent(kAuthor));
}

TEST_F(ProjectCompact, FR9WithoutTheFeatureTheSessionEnds) {
    send(kOlder, Transaction{{{}, 1}, 1, 0, {set("/A.x", 2)}});
    EXPECT_EQ(world.nextControl<ErrorMessage>(kOlder).code, "unknownFrame");
}

TEST_F(ProjectCompact, FR9AMulticastTransportDoesNotOfferIt) {
    world.host.sendsToAll = true;
    EXPECT_TRUE(join(9).features.empty());
}

}  // namespace
}  // namespace usdlive::server::projecttest
