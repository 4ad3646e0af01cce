// Tests who may edit a locked layer (LK1-LK4).
#include <gtest/gtest.h>

#include "FakeHost.h"
#include "usdlive/common/layer/LayerLock.h"

namespace usdlive::server::projecttest {
namespace {

class ProjectLocks : public ::testing::Test {
protected:
    void SetUp() override {
        world.options.administrators = {{"user3"}};
        world.options.idleLayerMs = 100 * world.options.lockTakeoverMs;  // keeps it loaded
        world.start();
        for (const SessionId session : {1, 2, 3}) world.join(session);
        world.receive(1, ControlMessage(OpenLayer{1, {"a.usda"}, 0}));
        world.load();
        world.host.sent.clear();
    }
    std::vector<Edit> lock(const LayerLock& lock) const {
        std::vector<Edit> edits;
        for (EditAction& action : lockEdits(lock))
            edits.push_back({{"a.usda"}, {"/", {}}, std::move(action)});
        return edits;
    }
    static LayerLock by(const std::string& user) { return {true, {user}, 1'000}; }

    /// Returns the refusal; nothing if the transaction was committed.
    std::optional<Error> outcome(SessionId session, std::vector<Edit> edits) {
        world.host.sent.clear();
        world.submit(session, ++sequences[session], std::move(edits), 0);
        world.store();
        const auto frame = world.next(session);
        const auto* refusal = std::get_if<RefusalFrame>(&frame);
        return refusal ? std::optional(refusal->error) : std::nullopt;
    }
    void expectLocked(SessionId session, std::vector<Edit> edits, const std::string& holder) {
        const auto error = outcome(session, std::move(edits));
        ASSERT_TRUE(error);
        EXPECT_EQ(error->code, ErrorCode::Locked);
        EXPECT_NE(error->message.find(holder), std::string::npos) << error->message;
    }

    World world;
    std::map<SessionId, std::uint64_t> sequences;
};

TEST_F(ProjectLocks, LK1OnlyTheHolderEditsALockedLayer) {
    EXPECT_FALSE(outcome(1, lock(by("user1"))));
    expectLocked(2, {set("/A.x", 1)}, "a.usda is locked by user1");
    EXPECT_FALSE(outcome(1, {set("/A.x", 2)}));
    EXPECT_FALSE(outcome(3, {set("/A.x", 3)}));  // an administrator
    EXPECT_FALSE(outcome(1, lock({})));
    EXPECT_FALSE(outcome(2, {set("/A.x", 4)}));
}

TEST_F(ProjectLocks, LK1ATransactionIsRefusedAsAWhole) {
    EXPECT_FALSE(outcome(1, lock(by("user1"))));
    std::vector<Edit> edits = lock({});
    edits.push_back(set("/A.x", 1));
    expectLocked(2, edits, "user1");
    EXPECT_TRUE(lockOf(*world.project->layer({"a.usda"})).locked);
}

TEST_F(ProjectLocks, LK2ALockIsTakenInOnesOwnName) {
    expectLocked(2, lock(by("user1")), "user2 is not user1");
    EXPECT_FALSE(outcome(1, lock(by("user1"))));
    expectLocked(2, lock({}), "user1");
    expectLocked(2, lock(by("user2")), "user1");
    EXPECT_FALSE(outcome(3, lock({})));
}

TEST_F(ProjectLocks, ALockWithoutHolderStopsAllAndAnyoneEndsIt) {
    EXPECT_FALSE(outcome(1, {{{"a.usda"},
                              {"/", {}},
                              SetField{"customLayerData", DictionaryKey{{"omni_layer", "locked"}},
                                       boolValue(true)}}}));
    expectLocked(1, {set("/A.x", 1)}, "a.usda is locked");
    EXPECT_FALSE(outcome(2, lock({})));
    EXPECT_FALSE(outcome(1, {set("/A.x", 1)}));
}

TEST_F(ProjectLocks, LK4TheLockOfAnAbsentHolderCanBeTaken) {
    EXPECT_FALSE(outcome(1, lock(by("user1"))));
    world.project->disconnected(1);
    world.host.nowMs += world.options.lockTakeoverMs - 1;
    expectLocked(2, lock(by("user2")), "user1");
    world.host.nowMs += 1;
    expectLocked(2, {set("/A.x", 1)}, "user1");  // only the lock can be taken over
    EXPECT_FALSE(outcome(2, lock(by("user2"))));
    EXPECT_FALSE(outcome(2, {set("/A.x", 1)}));
    world.join(1);
    expectLocked(1, {set("/A.x", 1)}, "user2");
}

TEST_F(ProjectLocks, LK4AbsenceCountsFromTheEndOfTheConnection) {
    EXPECT_FALSE(outcome(1, lock(by("user1"))));
    world.host.nowMs += 10 * world.options.lockTakeoverMs;
    world.receive(1, ControlMessage(world.hello(1)));  // a second hello ends the session
    ASSERT_TRUE(world.host.closed.contains(1));
    world.project->disconnected(1);
    expectLocked(2, lock(by("user2")), "user1");
}

TEST_F(ProjectLocks, LK4AClockThatJumpsFreesNoLock) {
    EXPECT_FALSE(outcome(1, lock(by("user1"))));
    world.project->disconnected(1);
    world.host.jumpMs = 100 * world.options.lockTakeoverMs;
    expectLocked(2, lock(by("user2")), "user1");
    world.host.jumpMs = -world.host.jumpMs;
    world.host.nowMs += world.options.lockTakeoverMs;
    EXPECT_FALSE(outcome(2, lock(by("user2"))));
}

TEST_F(ProjectLocks, LK3SavingALockedLayerIsRefused) {
    EXPECT_FALSE(outcome(1, lock(by("user1"))));
    world.host.sent.clear();
    world.receive(2, ControlMessage(SaveLayers{5, {{"a.usda"}}}));
    const auto saved = world.nextControl<LayersSaved>(2);
    ASSERT_EQ(saved.failed.size(), 1u);
    EXPECT_EQ(saved.failed[0].code, "locked");
    world.receive(1, ControlMessage(SaveLayers{6, {{"a.usda"}}}));
    EXPECT_TRUE(world.silent(1));  // the host has the commit
}

// ---- layer states

class ProjectStates : public ProjectLocks {
protected:
    LayerState state(SessionId session) {
        const auto message = world.nextControl<LayerStates>(session);
        EXPECT_EQ(message.layers.size(), 1u);
        return message.layers.at(0);
    }
    void joinWithStates(SessionId session) {
        Hello hello = world.hello(session);
        hello.features = {"states"};
        world.connect(session, hello);
        world.nextControl<Welcome>(session);
    }
};

TEST_F(ProjectStates, AreSentWhenTheyChange) {
    joinWithStates(4);
    EXPECT_EQ(state(4).editors, (std::vector<UserName>{{"user1"}}));
    world.receive(2, ControlMessage(OpenLayer{1, {"a.usda"}, 0}));
    EXPECT_EQ(state(4).editors, (std::vector<UserName>{{"user1"}, {"user2"}}));
    world.receive(2, ControlMessage(CloseLayer{{"a.usda"}}));
    EXPECT_EQ(state(4).editors, (std::vector<UserName>{{"user1"}}));

    world.submit(1, 1, lock(by("user1")));
    EXPECT_TRUE(world.silent(4));  // not durable yet
    world.store();
    world.nextFrame<CommitFrame>(4);
    const LayerState locked = state(4);
    EXPECT_TRUE(locked.locked);
    EXPECT_TRUE(locked.dirty);
    EXPECT_EQ(locked.holder, UserName{"user1"});
    EXPECT_EQ(locked.lockedAtMs, 1'000u);

    world.submit(1, 2, {set("/A.x", 1)});
    world.store();
    world.nextFrame<CommitFrame>(4);
    EXPECT_TRUE(world.silent(4));  // the state does not contain this
    world.project->layersSaved(1, 9, {2, {{{"a.usda"}, {}}}, {}});
    const LayerState saved = state(4);
    EXPECT_FALSE(saved.dirty);
    EXPECT_EQ(saved.saved, 2u);
    world.project->disconnected(1);
    EXPECT_TRUE(state(4).editors.empty());
}

TEST(LayerStates, LS1PlainLayersHaveNoState) {
    World world;
    world.unsaved = {{"b.usda"}};
    world.start();
    world.project->setFiles({{{"a.usda"}, FileTrace{}, true, "ada"}, {{"b.usda"}}});
    for (const SessionId session : {1, 2}) {
        Hello hello = world.hello(session);
        hello.features = {"states"};
        world.connect(session, hello);
        world.nextControl<Welcome>(session);
        const auto received = world.nextControl<usdlive::LayerStates>(session);
        ASSERT_EQ(received.layers.size(), 1u);
        EXPECT_EQ(received.layers[0].layer, LayerId{"b.usda"});
        EXPECT_TRUE(received.layers[0].dirty) << "the state at the start of the server";
        EXPECT_TRUE(world.silent(session));
    }
}

TEST_F(ProjectStates, AResumingSessionNamesItsOpenLayers) {
    joinWithStates(4);
    (void)state(4);
    world.project->disconnected(1);
    EXPECT_TRUE(state(4).editors.empty());
    Hello hello = world.hello(1);
    hello.resume = Hello::Resume{1, 0, {}};
    hello.open = {{{"a.usda"}, {"unknown.usda"}}};
    world.connect(1, hello);
    EXPECT_EQ(state(4).editors, (std::vector<UserName>{{"user1"}}));
}

TEST_F(ProjectStates, ASessionWithoutTheFeatureGetsNone) {
    world.receive(2, ControlMessage(OpenLayer{1, {"a.usda"}, 0}));
    EXPECT_TRUE(world.silent(1));
}

// ---- presence

class ProjectPresence : public ProjectLocks {
protected:
    void joinWithPresence(SessionId session) {
        Hello hello = world.hello(session);
        hello.features = {"presence"};
        world.connect(session, hello);
        world.nextControl<Welcome>(session);
    }
    void show(SessionId session, const std::string& path) {
        Presence presence;
        presence.client = {"somebody else"};
        presence.selection = {path};
        world.receive(session, ControlMessage(ShowPresence{presence}));
    }
};

TEST_F(ProjectPresence, PS1IsSentInSweeps) {
    joinWithPresence(4);
    joinWithPresence(5);
    EXPECT_FALSE(world.project->hasPresence());
    show(4, "/A");
    show(4, "/B");  // replaces the previous one
    show(5, "/C");
    EXPECT_TRUE(world.project->hasPresence());
    EXPECT_TRUE(world.silent(5));
    world.project->sweep(1'000);
    const auto received = world.nextControl<Presences>(5);
    EXPECT_EQ(world.nextControl<Presences>(4), received);
    ASSERT_EQ(received.shown.size(), 2u);
    EXPECT_EQ(received.shown[0].client, world.client(4));
    EXPECT_EQ(received.shown[0].user, UserName{"user4"});
    EXPECT_EQ(received.shown[0].selection, (std::vector<std::string>{"/B"}));
    world.project->sweep(1'050);
    EXPECT_TRUE(world.silent(5));
    EXPECT_TRUE(world.silent(1));  // does not have the feature
    joinWithPresence(6);
    EXPECT_EQ(world.nextControl<Presences>(6).shown.size(), 2u);
}

TEST_F(ProjectPresence, PS2APresenceWithoutUpdatesIsRemoved) {
    joinWithPresence(4);
    joinWithPresence(5);
    world.project->sweep(1'000);
    show(4, "/A");
    world.project->sweep(1'050);
    world.nextControl<Presences>(5);
    world.project->sweep(1'000 + kPresenceTimeMs - 1);
    show(4, "/A");  // sends it again
    world.project->sweep(1'000 + kPresenceTimeMs + 500);
    EXPECT_TRUE(world.silent(5));
    world.project->sweep(1'000 + 3 * kPresenceTimeMs);
    EXPECT_EQ(world.nextControl<Presences>(5).gone, (std::vector<ClientId>{world.client(4)}));
    EXPECT_FALSE(world.project->hasPresence());
}

TEST_F(ProjectPresence, AClientThatReturnsAfterALongSilenceIsShown) {
    joinWithPresence(4);
    joinWithPresence(5);
    show(4, "/A");
    world.project->sweep(1'000);
    world.project->sweep(1'000 + kPresenceTimeMs);
    EXPECT_FALSE(world.project->hasPresence());  // the sweep has ended
    world.host.sent.clear();
    show(4, "/A");
    world.project->sweep(100'000);
    EXPECT_EQ(world.nextControl<Presences>(5).shown.size(), 1u);
    EXPECT_TRUE(world.project->hasPresence());
}

TEST_F(ProjectPresence, APresenceIsRemovedWhenItsClientLeaves) {
    joinWithPresence(4);
    joinWithPresence(5);
    show(4, "/A");
    world.project->sweep(1'000);
    world.nextControl<Presences>(5);
    world.project->disconnected(4);
    EXPECT_EQ(world.nextControl<Presences>(5).gone, (std::vector<ClientId>{world.client(4)}));
}

TEST_F(ProjectPresence, ACameraIsAMatrixAndAPresenceHasABound) {
    joinWithPresence(4);
    joinWithPresence(5);
    Presence presence;
    presence.data = std::string(60'000, 'x');
    presence.editTarget = std::string(60'000, 'x');
    world.receive(4, ControlMessage(ShowPresence{presence}));
    EXPECT_EQ(world.nextControl<ErrorMessage>(4).code, "transactionTooLarge");
    presence = {};
    presence.camera = {1, 2, 3};
    world.receive(4, ControlMessage(ShowPresence{presence}));
    const auto refused = world.nextControl<ErrorMessage>(4);
    EXPECT_EQ(refused.code, "malformedControl");
    EXPECT_FALSE(refused.closing);
    world.project->sweep(1'000);
    EXPECT_TRUE(world.silent(5));
}

}  // namespace
}  // namespace usdlive::server::projecttest
