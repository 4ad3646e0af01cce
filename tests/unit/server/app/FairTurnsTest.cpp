// Tests whose work is done next, in simulated time.
#include "app/FairTurns.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <deque>
#include <map>
#include <random>
#include <vector>

using namespace usdlive::server;
using namespace std::chrono_literals;

namespace {

using Store = FairTurns::Store;

const Party kLight{"user ann", ""}, kHeavyParty{"user script", ""};

/// A project's strand in simulated time: sessions with queues of work, which FairTurns orders.
class Strand {
public:
    struct Work {
        FairTurns::Duration cost, arrived;
        int number = 0;
    };
    struct Done {
        SessionId session;
        int number;
        FairTurns::Duration wait;
    };

    void add(SessionId session, const Party& party) { parties_[session] = party; }

    /// Work of the session arrives now. The first is done at once if it may.
    void arrive(SessionId session, FairTurns::Duration cost, int count = 1) {
        auto& queue = queues_[session];
        const bool waits = !queue.empty();
        for (; count > 0; --count)
            queue.push_back({cost, now_.time_since_epoch(), ++numbers_[session]});
        if (waits) return;
        if (turns_.mayGo(parties_.at(session), store, now_))
            perform(session);
        else
            turns_.wait(session, parties_.at(session));
    }

    /// Lets time pass until `end`, doing what may be done.
    void runUntil(FairTurns::Duration end) {
        const FairTurns::Time until(end);
        while (now_ < until) {
            if (const auto session = turns_.next(store, now_)) {
                perform(*session);
                continue;
            }
            const auto due = turns_.due(store, now_);
            now_ = due && *due < until ? std::max(*due, now_ + 1us) : until;
        }
    }

    [[nodiscard]] FairTurns::Duration now() const { return now_.time_since_epoch(); }
    [[nodiscard]] std::size_t waiting(SessionId session) { return queues_[session].size(); }
    [[nodiscard]] FairTurns::Duration used(const Party& party) { return used_[party]; }

    Store store = Store::Free;
    std::vector<Done> done;

private:
    void perform(SessionId session) {
        auto& queue = queues_[session];
        const Work work = queue.front();
        queue.pop_front();
        done.push_back({session, work.number, now_.time_since_epoch() - work.arrived});
        now_ += work.cost;
        used_[parties_.at(session)] += work.cost;
        turns_.spent(parties_.at(session), work.cost, now_);
        if (!queue.empty()) turns_.wait(session, parties_.at(session));
    }

    FairTurns turns_;
    FairTurns::Time now_{1s};
    std::map<SessionId, Party> parties_;
    std::map<SessionId, std::deque<Work>> queues_;
    std::map<SessionId, int> numbers_;
    std::map<Party, FairTurns::Duration> used_;
};

}  // namespace

TEST(FairTurns, SE23OnePartyNeverPauses) {
    Strand strand;
    strand.add(1, kHeavyParty);
    strand.arrive(1, 200us, 5'000);
    strand.runUntil(2s);
    EXPECT_EQ(strand.waiting(1), 0u);
    EXPECT_EQ(strand.used(kHeavyParty), 1s);
}

TEST(FairTurns, SE23TheLightNeverWaitMoreThanOneTurnForTheHeavy) {
    Strand strand;
    strand.add(1, kHeavyParty);
    strand.add(2, kLight);
    strand.arrive(1, FairTurns::kTurn, 20'000);
    for (int count = 0; count < 200; ++count) {
        strand.runUntil(strand.now() + 7ms);
        strand.arrive(2, 100us);
    }
    for (const auto& done : strand.done)
        if (done.session == 2) {
            EXPECT_LE(done.wait, FairTurns::kTurn);
        }
    EXPECT_EQ(strand.waiting(2), 0u);
    EXPECT_GT(strand.waiting(1), 0u);
    // The heavy one is slow, and does not stop.
    const double share =
        double(strand.used(kHeavyParty).count()) / double((strand.now() - 1s).count());
    EXPECT_GT(share, FairTurns::kHeavyLoad);
    EXPECT_LT(share, FairTurns::kLightLoad / 2 * 1.25);
}

TEST(FairTurns, SE23HeavyPartiesDoNotPauseForEachOther) {
    Strand strand;
    const Party another{"user farm", ""};
    strand.add(1, kHeavyParty);
    strand.add(2, another);
    strand.arrive(1, FairTurns::kTurn, 20'000);
    strand.arrive(2, FairTurns::kTurn, 20'000);
    const auto begin = strand.now();
    strand.runUntil(begin + 3s);
    const auto used = strand.used(kHeavyParty) + strand.used(another);
    EXPECT_GT(used, 0.98 * (strand.now() - begin));
    EXPECT_NEAR(double(strand.used(another).count()) / double(used.count()), 0.5, 0.05);
    // Now somebody who edits a little does not wait for them.
    strand.add(3, kLight);
    for (int count = 0; count < 100; ++count) {
        strand.arrive(3, 100us);
        strand.runUntil(strand.now() + 7ms);
    }
    for (const auto& done : strand.done)
        if (done.session == 3) {
            EXPECT_LE(done.wait, FairTurns::kTurn);
        }
}

TEST(FairTurns, SE23FiftySessionsOfAUserHaveTheShareOfOne) {
    Strand strand;
    strand.add(1, kLight);
    for (SessionId session = 100; session < 150; ++session) strand.add(session, kHeavyParty);
    strand.arrive(1, FairTurns::kTurn, 5'000);
    for (SessionId session = 100; session < 150; ++session)
        strand.arrive(session, FairTurns::kTurn, 100);
    strand.runUntil(3s);
    const double ratio =
        double(strand.used(kLight).count()) / double(strand.used(kHeavyParty).count());
    EXPECT_GT(ratio, 0.8);
    EXPECT_LT(ratio, 1.25);
}

TEST(FairTurns, SE23AClaimedNameDividesTheShareOfItsAddress) {
    Strand strand;
    const Party honest{"at 10.0.0.1", "ann"};
    strand.add(1, honest);
    for (SessionId session = 100; session < 150; ++session)
        strand.add(session, {"at 10.0.0.2", "name" + std::to_string(session)});
    strand.arrive(1, FairTurns::kTurn, 5'000);
    for (SessionId session = 100; session < 150; ++session)
        strand.arrive(session, FairTurns::kTurn, 100);
    strand.runUntil(3s);
    FairTurns::Duration others{};
    for (SessionId session = 100; session < 150; ++session)
        others += strand.used({"at 10.0.0.2", "name" + std::to_string(session)});
    const double ratio = double(strand.used(honest).count()) / double(others.count());
    EXPECT_GT(ratio, 0.8);
    EXPECT_LT(ratio, 1.3);
}

TEST(FairTurns, SE23TheHeavyWaitForTheStoreAndAllWaitForAFullOne) {
    FairTurns turns;
    const FairTurns::Time now(1s);
    turns.spent(kLight, 1us, now);
    turns.spent(kHeavyParty, 200ms, now);
    EXPECT_FALSE(turns.mayGo(kHeavyParty, Store::Free, now));
    EXPECT_TRUE(turns.mayGo(kLight, Store::Free, now));
    const auto later = now + FairTurns::kLongestPause;
    turns.wait(1, kHeavyParty);
    EXPECT_EQ(turns.next(Store::Busy, later), std::nullopt);
    EXPECT_EQ(turns.due(Store::Busy, later), std::nullopt);
    EXPECT_TRUE(turns.mayGo(kLight, Store::Busy, later));
    EXPECT_FALSE(turns.mayGo(kLight, Store::Full, later));
    EXPECT_EQ(turns.next(Store::Free, later), 1u);
}

TEST(FairTurns, SE23APauseIsBoundedAfterAnyTurn) {
    FairTurns turns;
    const FairTurns::Time now(1s);
    turns.spent(kLight, 1us, now);
    turns.spent(kHeavyParty, 60s, now);  // a transaction that cannot be divided
    turns.wait(1, kHeavyParty);
    EXPECT_EQ(turns.next(Store::Free, now), std::nullopt);
    EXPECT_EQ(turns.due(Store::Free, now), now + FairTurns::kLongestPause);
    EXPECT_EQ(turns.next(Store::Free, now + FairTurns::kLongestPause), 1u);
}

// Random parties with random work. Whatever happens: the work of a session keeps its order; nobody
// starves; when work waits and nobody has a turn, it is only for the pause of a heavy party.
TEST(FairTurns, SE23NobodyStarvesAndTheOrderOfASessionIsKept) {
    for (unsigned seed = 0; seed < 200; ++seed) {
        SCOPED_TRACE(seed);
        std::mt19937 random{seed};
        Strand strand;
        const unsigned parties = 1 + random() % 6, sessions = parties + random() % 10;
        for (SessionId session = 1; session <= sessions; ++session)
            strand.add(session, {"group " + std::to_string(random() % parties),
                                 random() % 2 ? "" : std::to_string(random() % 3)});
        for (int step = 0; step < 300; ++step) {
            const SessionId session = 1 + random() % sessions;
            strand.arrive(session, std::chrono::microseconds(10 + random() % 300),
                          1 + int(random() % (session == 1 ? 40 : 3)));
            strand.runUntil(strand.now() + std::chrono::microseconds(random() % 3'000));
        }
        strand.runUntil(strand.now() + 60s);
        std::map<SessionId, int> last;
        for (const auto& done : strand.done) ASSERT_EQ(done.number, ++last[done.session]);
        for (SessionId session = 1; session <= sessions; ++session)
            EXPECT_EQ(strand.waiting(session), 0u);
    }
}

TEST(FairTurns, SE23ASessionThatHasEndedHasNoTurn) {
    FairTurns turns;
    const FairTurns::Time now(1s);
    turns.wait(1, kHeavyParty);
    turns.wait(2, kHeavyParty);
    turns.forget(1);
    EXPECT_FALSE(turns.isWaiting(1));
    EXPECT_EQ(turns.next(Store::Free, now), 2u);
    EXPECT_TRUE(turns.isEmpty());
}
