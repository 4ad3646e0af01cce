// Tests a bounded history (CH4).
#include <gtest/gtest.h>

#include "FakeHost.h"
#include "storage/MemoryCommitStore.h"

namespace usdlive::server::projecttest {
namespace {

constexpr std::int64_t kDayMs = 24 * 60 * 60 * 1'000;

class HistoryTest : public ::testing::Test {
protected:
    HistoryTest() { begin({}); }

    /// Creates sessions 1 and 2, and ten commits of session 1.
    void begin(Project::Options options) {
        world.emplace(std::move(options));
        world->join(1);
        world->receive(1, ControlMessage(OpenLayer{1, {"a.usda"}, 0}));
        world->load();
        world->join(2);
        for (std::uint64_t sequence = 1; sequence <= 10; ++sequence)
            world->submit(1, sequence, {set("/A.x", double(sequence))});
        world->store();
        world->host.sent.clear();
    }
    void ask(std::optional<std::uint64_t> days, SessionId session = 1) {
        world->receive(session, ControlMessage(CompactHistory{7, days}));
    }
    void compacted(Revision revision) {
        world->base = {revision, world->host.log[revision - 1].hash};
        world->project->baseChanged(world->base);
        world->project->compacted(CompactOutcome{900, 300});
    }
    void compactTo(Revision revision) {
        ask(0);
        world->project->baseFound(BaseLimit{revision, {}});
        compacted(revision);
        (void)world->nextControl<HistoryCompacted>(1);
    }
    ErrorMessage error(SessionId session = 1) { return world->nextControl<ErrorMessage>(session); }

    std::optional<World> world;
};

TEST_F(HistoryTest, CH4CompactsOlderCommitsAndReportsTheResult) {
    ask(3);
    ASSERT_EQ(world->host.findingBase.size(), 1u);
    EXPECT_EQ(world->host.findingBase.front(),
              std::pair(world->host.nowMs - 3 * kDayMs, Revision(10)));
    world->project->baseFound(BaseLimit{4, "the checkpoint 'lunch'"});
    EXPECT_EQ(world->host.compacting, std::vector<Revision>{4});
    EXPECT_TRUE(world->silent(1));
    compacted(4);
    EXPECT_EQ(world->nextControl<HistoryCompacted>(1),
              (HistoryCompacted{7, 4, 4, 900, 300, "the checkpoint 'lunch'"}));
    ask(3);
    world->project->baseFound(BaseLimit{4, {}});
    EXPECT_EQ(world->host.compacting.size(), 1u) << "there is nothing to do";
    EXPECT_EQ(world->nextControl<HistoryCompacted>(1), (HistoryCompacted{7, 4, 0, 0, 0, {}}));
}

TEST_F(HistoryTest, CH6AClockThatJumpsReplacesNothing) {
    constexpr std::int64_t kYearMs = 365 * kDayMs;
    const auto before = [this] {
        ask(30);
        world->project->baseFound(BaseLimit{0, {}});
        (void)world->nextControl<HistoryCompacted>(1);
        const std::int64_t found = world->host.findingBase.back().first;
        return (found - world->host.nowMs) / kDayMs;
    };
    world->host.jumpMs = kYearMs;
    EXPECT_EQ(before(), -30) << "a year ahead";
    world->host.nowMs += 3'599'000;
    EXPECT_EQ(before(), -30) << "still a year ahead";
    world->host.jumpMs = -2 * kYearMs;
    EXPECT_EQ(before(), -2 * 365 - 30) << "the earlier one";
    world->host.jumpMs = 0;
    EXPECT_EQ(before(), -30);
    world->host.jumpMs = kYearMs;
    EXPECT_EQ(before(), -30);
    world->host.nowMs += 3'600'000;
    EXPECT_EQ(before(), 365 - 30) << "it has stayed so: the clock was wrong before";
}

TEST_F(HistoryTest, CH4CompactionsRunOneAfterTheOther) {
    ask(3);
    ask(2, 2);
    EXPECT_EQ(world->host.findingBase.size(), 1u);
    world->project->baseFound(fail(ErrorCode::StorageFailed, "it cannot be read"));
    EXPECT_EQ(error().code, "storageFailed");
    EXPECT_EQ(world->host.findingBase.size(), 2u);
    world->project->baseFound(BaseLimit{2, {}});
    world->project->compacted(fail(ErrorCode::StorageFull, "full"));
    EXPECT_EQ(error(2).code, "storageFull");
    world->receive(1, ControlMessage(OpenLayer{2, {"a.usda"}, 1}));
    EXPECT_EQ(world->host.readingHistory.size(), 1u) << "everything is unchanged";
}

TEST_F(HistoryTest, CH4KeepsCommitsThatAConnectedClientNeeds) {
    world->host.congestedSessions.insert(2);
    world->receive(2, ControlMessage(RequestLog{3, 6, 9}));
    ask(0);
    world->project->baseFound(BaseLimit{10, {}});
    EXPECT_EQ(world->host.compacting, std::vector<Revision>{5});
    compacted(5);
    EXPECT_NE(world->nextControl<HistoryCompacted>(1).keptFor.find("revision 6"),
              std::string::npos);

    world->receive(1, ControlMessage(OpenLayer{2, {"a.usda"}, 5}));
    ask(0);
    world->project->baseFound(BaseLimit{10, {}});
    EXPECT_EQ(world->host.compacting.size(), 1u) << "revision 5 is being read";
}

TEST_F(HistoryTest, CH4OlderRevisionsAreRefusedAsSoonAsTheBaseIsChosen) {
    ask(0);
    world->project->baseFound(BaseLimit{5, {}});
    for (int done = 0; done < 2; ++done) {
        world->receive(1, ControlMessage(RequestLog{3, 5, 9}));
        auto refused = error();
        EXPECT_EQ(refused.code, "historyReplaced");
        EXPECT_NE(refused.message.find("up to 5"), std::string::npos) << refused.message;
        world->receive(1, ControlMessage(OpenLayer{3, {"a.usda"}, 4}));
        EXPECT_EQ(error().code, "historyReplaced");
        if (done) break;
        compacted(5);
        (void)world->nextControl<HistoryCompacted>(1);
    }
    world->receive(1, ControlMessage(RequestLog{3, 0, 6}));
    (void)world->nextControl<LogBegin>(1);
    EXPECT_EQ(world->nextFrame<CommitFrame>(1).commit.revision, 6u) << "the oldest revision";
}

TEST_F(HistoryTest, ALogThatEndsBeforeItBeginsIsRefused) {
    world->receive(1, ControlMessage(RequestLog{3, 7, 6}));
    EXPECT_EQ(error().code, "invalidArgument");
    compactTo(5);
    for (const Revision from : {0, 6}) {
        world->receive(1, ControlMessage(RequestLog{3, from, 4}));
        EXPECT_EQ(error().code, "historyReplaced") << from;
    }
    world->receive(1, ControlMessage(RequestLog{4, 6, 6}));
    (void)world->nextControl<LogBegin>(1);
}

TEST_F(HistoryTest, CH4AClientBeforeTheBaseJoinsAgain) {
    compactTo(5);
    const auto resume = [&](SessionId session, Revision revision) {
        auto hello = world->hello(session);
        hello.resume = Hello::Resume{world->epoch, revision,
                                     revision == 0 ? Hash() : world->host.log[revision - 1].hash};
        world->connect(session, hello);
    };
    for (const Revision revision : {0, 4}) {
        resume(3, revision);
        EXPECT_EQ(error(3).code, "staleBase");
        const auto welcome = world->nextControl<Welcome>(3);
        EXPECT_FALSE(welcome.resumed);
        EXPECT_EQ(welcome.base, Revision(5));
        world->project->disconnected(3);
        world->host.sent[3].clear();
    }
    resume(3, 5);
    EXPECT_TRUE(world->nextControl<Welcome>(3).resumed) << "from the base itself";
    EXPECT_EQ(world->nextFrame<CommitFrame>(3).commit.revision, 6u);
    world->restart();
    resume(4, 4);
    EXPECT_EQ(error(4).code, "staleBase") << "also after a restart";
}

TEST_F(HistoryTest, ID2AnEditorOfAnotherHistoryIsNoticedWhereTheBaseWillBe) {
    world->restart();  // the hashes are in the store only
    world->join(1);
    ask(0);
    world->project->baseFound(BaseLimit{5, {}});
    const auto resume = [&](SessionId session, const Hash& hash) {
        auto hello = world->hello(session);
        hello.resume = Hello::Resume{world->epoch - 1, 5, hash};
        world->connect(session, hello);
        world->answerQuestions();
    };
    const Hash own = world->host.log[4].hash;
    resume(3, Hash());
    world->answerRead();
    EXPECT_EQ(error(3).code, "historyDiverged") << "before it is replaced";
    resume(4, own);
    world->answerRead();
    EXPECT_TRUE(world->nextControl<Welcome>(4).resumed);

    const Error replaced{ErrorCode::HistoryReplaced, "the history begins at 5"};
    const auto answerReplaced = [&](SessionId session) {
        world->host.reading.pop_front();
        world->project->commitsRead(session, tl::unexpected(replaced));
    };
    resume(5, Hash());
    answerReplaced(5);
    const auto closed = error(5);
    EXPECT_TRUE(closed.closing && closed.code == "historyReplaced") << "it connects again";

    resume(6, Hash());
    resume(7, own);
    compacted(5);
    answerReplaced(6);
    EXPECT_EQ(error(6).code, "historyDiverged") << "compared with the base";
    answerReplaced(7);
    EXPECT_TRUE(world->nextControl<Welcome>(7).resumed);
}

TEST_F(HistoryTest, CH4DaysAndAdministrators) {
    ask({});
    EXPECT_EQ(error().code, "invalidArgument");
    EXPECT_TRUE(world->host.findingBase.empty());
    world->project->boundHistory();
    EXPECT_TRUE(world->host.findingBase.empty()) << "no age is configured";
    ask(~std::uint64_t(0));
    EXPECT_EQ(error().code, "invalidArgument");

    Project::Options options;
    options.historyDays = 2;
    options.administrators = {{"user1"}};
    begin(options);
    world->project->boundHistory();
    world->project->boundHistory();
    ask({});
    ask({}, 2);
    EXPECT_NE(error(2).message.find("--admin"), std::string::npos);
    for (int asked = 0; asked < 2; ++asked) {
        ASSERT_EQ(world->host.findingBase.size(), 1u + asked);
        EXPECT_EQ(world->host.findingBase.back().first, world->host.nowMs - 2 * kDayMs);
        world->project->baseFound(BaseLimit{});
    }
    EXPECT_EQ(world->host.findingBase.size(), 2u) << "one compaction for both";
    EXPECT_EQ(world->nextControl<HistoryCompacted>(1).base, 0u);
}

TEST_F(HistoryTest, CH5TheSpaceOfTheStoreIsReported) {
    world->receive(1, ControlMessage(RequestStorage{9}));
    EXPECT_EQ(world->host.measuring, (std::vector{std::pair(SessionId(1), std::uint64_t(9))}));
    Storage storage;
    storage.log = 5;
    storage.layers = {{{"a.usda"}, 1, 2, 3, 4, 5, 6}};
    world->project->storageMeasured(1, 9, storage);
    storage.request = 9;
    EXPECT_EQ(world->nextControl<Storage>(1), storage);
}

/// Commits that are a second apart, the first at 1 s.
class FindBase : public ::testing::Test {
protected:
    FindBase() {
        std::vector<CommitRecord> records;
        Hash hash;
        for (Revision revision = 1; revision <= 20; ++revision) {
            Commit commit;
            commit.revision = revision;
            commit.timeMs = std::int64_t(revision) * 1'000;
            commit.previous = hash;
            CommitRecord record;
            record.revision = revision;
            record.frame = std::make_shared<const Bytes>(encodeFrame(CommitFrame{commit}));
            record.hash = hash = chainHash(hash, ByteView(*record.frame).subspan(4));
            records.push_back(std::move(record));
        }
        EXPECT_TRUE(store->append(records));
    }
    Revision find(std::int64_t beforeMs, Revision upTo = 20) {
        return findBase(*store, beforeMs, upTo).value().revision;
    }
    std::unique_ptr<CommitStore> store = createMemoryCommitStore(createMemoryDisk());
};

TEST_F(FindBase, IsTheNewestOlderCommit) {
    EXPECT_EQ(find(0), 0u);
    EXPECT_EQ(find(1'000), 0u);
    EXPECT_EQ(find(1'001), 1u);
    EXPECT_EQ(find(7'000), 6u);
    EXPECT_EQ(find(7'500), 7u);
    EXPECT_EQ(find(99'000), 20u);
    EXPECT_EQ(find(99'000, 12), 12u);
    ASSERT_TRUE(store->compact(5, [] { return true; }));
    EXPECT_EQ(find(3'000), 5u);
    EXPECT_EQ(find(7'500), 7u);
}

TEST_F(FindBase, IsNotBeyondACheckpoint) {
    ASSERT_TRUE(store->addCheckpoint({"supper", 9, {}, 0}));
    ASSERT_TRUE(store->addCheckpoint({"lunch", 6, {}, 0}));
    const auto limit = findBase(*store, 99'000, 20);
    EXPECT_EQ(limit->revision, 6u);
    EXPECT_NE(limit->keptFor.find("'lunch'"), std::string::npos);
    EXPECT_EQ(find(3'500), 3u);
    EXPECT_EQ(findBase(*store, 3'500, 20)->keptFor, "");
}

}  // namespace
}  // namespace usdlive::server::projecttest
