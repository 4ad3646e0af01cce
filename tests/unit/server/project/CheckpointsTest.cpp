// Tests named revisions (CP1, CP2).
#include <gtest/gtest.h>

#include "FakeHost.h"

namespace usdlive::server::projecttest {
namespace {

class CheckpointsTest : public ::testing::Test {
protected:
    CheckpointsTest() {
        world.join(1);
        world.receive(1, ControlMessage(OpenLayer{1, {"a.usda"}, 0}));
        world.load();
        world.host.sent.clear();
    }
    void name(const std::string& name) {
        world.receive(1, ControlMessage(CreateCheckpoint{5, name}));
    }
    void expectRefused(const std::string& code) {
        const auto error = world.nextControl<ErrorMessage>(1);
        EXPECT_EQ(error.code, code);
        EXPECT_EQ(error.request, 5u);
        EXPECT_FALSE(error.closing);
        EXPECT_TRUE(world.host.naming.empty());
    }

    World world;
};

TEST_F(CheckpointsTest, CP1NamesTheSubmittedRevisionWhenItIsDurable) {
    world.submit(1, 1, {set("/A.x", 1)});
    name("lunch");
    EXPECT_TRUE(world.host.naming.empty()) << "it is not stored yet";
    world.submit(1, 2, {set("/A.x", 2)});
    world.store();
    ASSERT_EQ(world.host.naming.size(), 1u);
    const auto& [session, request, checkpoint] = world.host.naming.front();
    EXPECT_EQ(checkpoint, (Checkpoint{"lunch", 1, {"user1"}, std::uint64_t(world.host.nowMs)}));
    world.host.sent.clear();
    world.project->checkpointAdded(session, request, checkpoint);
    EXPECT_EQ(world.nextControl<CheckpointCreated>(1), (CheckpointCreated{5, checkpoint}));
}

TEST_F(CheckpointsTest, CP1ARevertedRevisionGetsNoName) {
    world.submit(1, 1, {set("/A.x", 1)});
    world.store();
    world.submit(1, 2, {set("/A.x", 2)});
    name("lunch");
    world.host.sent.clear();
    world.project->appendFailed({ErrorCode::StorageFull, "full"},
                                {1, world.host.log.back().hash, world.epoch});
    EXPECT_EQ(world.nextFrame<RefusalFrame>(1).sequence, 2u);
    expectRefused("storageFull");
}

TEST_F(CheckpointsTest, CP1RefusesInvalidNames) {
    world.submit(1, 1, {set("/A.x", 1)});
    world.store();
    world.host.sent.clear();
    for (const std::string& bad : {std::string(), std::string(201, 'x'), std::string("a\nb")}) {
        name(bad);
        expectRefused("invalidArgument");
    }
}

TEST_F(CheckpointsTest, SE22ASlowerPaceAfterAThousand) {
    world.submit(1, 1, {set("/A.x", 1)});
    world.store();
    for (int number = 0; number < 1'000; ++number) name("c" + std::to_string(number));
    EXPECT_EQ(world.host.naming.size(), 1'000u);
    world.host.naming.clear();
    world.host.sent.clear();
    name("more");
    expectRefused("tooManyRequests");
    world.connect(2, {}, "10.0.0.2");
    world.receive(2, ControlMessage(CreateCheckpoint{5, "of another user"}));
    EXPECT_EQ(world.host.naming.size(), 1u);
    world.host.naming.clear();
    world.host.nowMs += 12'500;
    for (const char* next : {"one", "two", "three"}) name(next);
    EXPECT_EQ(world.host.naming.size(), 2u) << "one more after each 6 s";
}

TEST_F(CheckpointsTest, CP1NeedsACommit) {
    name("lunch");
    expectRefused("invalidArgument");
}

TEST_F(CheckpointsTest, CP1TheStoresErrorIsReported) {
    world.project->checkpointAdded(1, 5, fail(ErrorCode::CheckpointExists, "there is one"));
    expectRefused("checkpointExists");
    world.project->checkpointAdded(9, 5, fail(ErrorCode::CheckpointExists, "nobody is there"));
}

TEST_F(CheckpointsTest, CP2AreListedInOrder) {
    const Checkpoint first{"z", 1, {}, 0}, second{"a", 2, {}, 0}, third{"b", 2, {}, 0};
    world.project->checkpointsRead(1, 6, std::vector{third, second, first});
    EXPECT_EQ(world.nextControl<Checkpoints>(1), (Checkpoints{6, {first, second, third}}));
}

}  // namespace
}  // namespace usdlive::server::projecttest
