// Tests a line of history by itself, without a project: what it orders, notifies and rolls back.
#include "project/lines/HistoryLine.h"

#include <gtest/gtest.h>

#include <deque>

#include "project/CommitContent.h"

namespace usdlive::server::linetest {
namespace {

const LayerId kLineLayer{"a.usda"};
const ClientId kClient{"client"};

class Log : public ports::CommitLog {
public:
    void append(CommitRecord commit) override { appended.push_back(std::move(commit)); }
    std::deque<CommitRecord> appended;
};

class FixedClock : public ports::Clock {
public:
    std::int64_t wallClockMs() override { return nowMs; }
    std::int64_t steadyMs() override { return 0; }
    std::int64_t nowMs = 1'700'000'000'000;
};

class Follower : public LineListener {
public:
    void ordered(const OrderedCommit& commit) override { add("ordered", commit.revision); }
    void durable(const OrderedCommit& commit) override { add("durable", commit.revision); }
    void becameDurable(Revision upTo) override { add("up to", upTo); }
    void rolledBack(const Error& error, const LostCommits& lost) override {
        for (const OrderedCommit& commit : lost.commits) add(error.message, commit.revision);
        changed = lost.changed;
    }
    std::vector<std::string> events;
    std::set<LayerId> changed;

private:
    void add(const std::string& what, Revision revision) {
        events.push_back(what + " " + std::to_string(revision));
    }
};

LayerDoc sample() {
    LayerDoc doc;
    EXPECT_TRUE(doc.apply("/A", CreateSpec{SpecKind::Prim}));
    return doc;
}

Edit create(const std::string& path) {
    return {kLineLayer, {path, {}}, CreateSpec{SpecKind::Prim}};
}
Edit erase(const std::string& path) { return {kLineLayer, {path, {}}, DeleteSpec{}}; }

class HistoryLineTest : public ::testing::Test {
protected:
    HistoryLineTest() { line.addListener(follower); }

    std::variant<Revision, Refused> submit(HistoryLine& to, std::vector<Edit> edits,
                                           HistoryLine::Check check = {}) {
        const Transaction transaction{{kClient, ++sequence}, to.durable(), 0, std::move(edits)};
        return to.commit({transaction, 100, user, std::move(check)}, creations);
    }
    Revision commit(HistoryLine& to, std::vector<Edit> edits) {
        return std::get<Revision>(submit(to, std::move(edits)));
    }
    [[nodiscard]] static bool has(const HistoryLine& line, const std::string& path) {
        return line.doc(kLineLayer)->has(path);
    }

    Log log, branchLog;
    FixedClock clock;
    TimeOfDay time{clock};
    UserName user{"ada"};
    OwnCreations creations;
    std::uint64_t sequence = 0;
    Follower follower;
    HistoryLine line{{}, {{0, {}, 1}, 0, {}, {{kLineLayer, sample()}}}, log, time};
};

TEST_F(HistoryLineTest, OrdersCommitsAndNotifiesWhenTheyAreDurable) {
    EXPECT_EQ(commit(line, {create("/B")}), 1u);
    EXPECT_EQ(commit(line, {create("/C")}), 2u);
    EXPECT_EQ(line.executed(), 2u);
    EXPECT_EQ(line.durable(), 0u);
    ASSERT_EQ(log.appended.size(), 2u);
    EXPECT_EQ(log.appended[1].hash, line.executedHash());
    line.appended(2);
    EXPECT_EQ(line.durableHash(), line.executedHash());
    EXPECT_EQ(follower.events, (std::vector<std::string>{"ordered 1", "ordered 2", "durable 1",
                                                         "durable 2", "up to 2"}));
}

TEST_F(HistoryLineTest, CH6TimesOfCommitsNeverFall) {
    const auto made = [this] {
        commit(line, {create("/N" + std::to_string(line.executed()))});
        const CommitRecord& record = log.appended.back();
        return decodeCommit({record.revision, record.frame, record.hash})->timeMs;
    };
    const std::int64_t begin = clock.nowMs;
    EXPECT_EQ(made(), begin);
    for (const std::int64_t jump : {365LL * 86'400'000, -2 * 365LL * 86'400'000, 0LL}) {
        clock.nowMs = begin + jump;
        EXPECT_EQ(made(), begin) << "a jump of the clock";
    }
    clock.nowMs = begin + 50'000;
    EXPECT_EQ(made(), begin + 50'000);
    clock.nowMs = begin + 40'000;
    EXPECT_EQ(made(), begin + 50'000);
    HistoryLine later{{}, {{0, {}, 2}, 0, {}, {{kLineLayer, sample()}}, begin + 90'000}, log, time};
    commit(later, {create("/B")});
    const CommitRecord& record = log.appended.back();
    EXPECT_EQ(decodeCommit({record.revision, record.frame, record.hash})->timeMs, begin + 90'000)
        << "the store has a later commit";
}

TEST_F(HistoryLineTest, WhatItsCheckRefusesChangesNothing) {
    const auto refused =
        submit(line, {erase("/A")}, [](const Executed& executed, const LayerDocs& before) {
            EXPECT_EQ(executed.edits.size(), 1u);
            EXPECT_TRUE(before.at(kLineLayer).has("/A"));
            return std::optional(Refused{{ErrorCode::Locked, "locked"}});
        });
    EXPECT_EQ(std::get<Refused>(refused).error.code, ErrorCode::Locked);
    EXPECT_TRUE(has(line, "/A"));
    EXPECT_TRUE(log.appended.empty());
    EXPECT_TRUE(follower.events.empty());
    // The refused deletion carries no address of a later transaction away.
    EXPECT_EQ(commit(line, {create("/A/B")}), 1u);
    EXPECT_TRUE(has(line, "/A/B"));
}

TEST_F(HistoryLineTest, RollsBackCommitsThatTheLogCouldNotAppend) {
    commit(line, {create("/B")});
    const CommitStore::Head kept{1, line.executedHash(), 2};
    commit(line, {erase("/A")});
    commit(line, {create("/C")});
    follower.events.clear();
    line.appendFailed({ErrorCode::StorageFull, "lost"}, kept);
    EXPECT_EQ(follower.events,
              (std::vector<std::string>{"durable 1", "up to 1", "lost 2", "lost 3", "up to 1"}));
    EXPECT_EQ(follower.changed, std::set{kLineLayer});
    EXPECT_EQ(line.executed(), 1u);
    EXPECT_EQ(line.executedHash(), kept.hash);
    EXPECT_EQ(line.epoch(), 2u);
    EXPECT_EQ(line.doc(kLineLayer), nullptr) << "it is to be loaded again";

    // The deletion that was rolled back carries no address away, either.
    LayerDoc again = sample();
    EXPECT_TRUE(again.apply("/B", CreateSpec{SpecKind::Prim}));
    line.put(kLineLayer, again);
    EXPECT_EQ(commit(line, {create("/A/D")}), 2u);
    EXPECT_TRUE(has(line, "/A/D"));
}

TEST_F(HistoryLineTest, AHeadThatIsNoCommitOfTheLineIsAnError) {
    commit(line, {create("/B")});
    EXPECT_THROW(line.appendFailed({ErrorCode::StorageFull, "lost"}, {1, sha256({}), 1}),
                 std::logic_error);
}

TEST_F(HistoryLineTest, ABranchContinuesFromARevisionAndDoesNotChangeItsOrigin) {
    commit(line, {create("/B")});
    line.appended(1);
    const CommitStore::Head head{line.durable(), line.durableHash(), line.epoch()};
    HistoryLine branch{{}, {head, 0, {}, line.docs()}, branchLog, time};

    EXPECT_EQ(commit(branch, {erase("/B")}), 2u);
    EXPECT_EQ(commit(line, {create("/B/C")}), 2u);
    EXPECT_FALSE(has(branch, "/B"));
    EXPECT_TRUE(has(line, "/B/C"));
    EXPECT_NE(branch.executedHash(), line.executedHash());
    ASSERT_EQ(branchLog.appended.size(), 1u);
    EXPECT_EQ(log.appended.size(), 2u);

    branch.appendFailed({ErrorCode::StorageFull, "lost"}, head);
    EXPECT_EQ(branch.executedHash(), head.hash);
    EXPECT_EQ(line.executed(), 2u);
    EXPECT_TRUE(has(line, "/B/C"));
}

}  // namespace
}  // namespace usdlive::server::linetest
