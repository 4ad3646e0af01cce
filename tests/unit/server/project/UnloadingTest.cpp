// Tests unloading layers that nobody has open.
#include <gtest/gtest.h>

#include "FakeHost.h"
#include "usdlive/common/layer/GlobalMuteness.h"
#include "usdlive/common/layer/LayerLock.h"

namespace usdlive::server::projecttest {
namespace {

const LayerId kA{"a.usda"}, kB{"b.usda"};

Project::Options atOnce() {
    Project::Options options;
    options.idleLayerBytes = 0;
    return options;
}

void open(World& world, SessionId session, const LayerId& layer = kA, bool imported = false) {
    world.receive(session, ControlMessage(OpenLayer{1, layer, 0}));
    if (!world.host.loading.empty()) world.load(imported);
    world.store();
    world.host.sent[session].clear();
}

TEST(ProjectUnloading, ALayerIsUnloadedAfterItsLastSession) {
    World world(atOnce());
    world.join(1);
    world.join(2);
    open(world, 1);
    open(world, 2);
    world.receive(1, ControlMessage(CloseLayer{kA}));
    EXPECT_NE(world.project->layer(kA), nullptr);
    world.project->disconnected(2);
    EXPECT_EQ(world.project->layer(kA), nullptr);
    EXPECT_EQ(world.project->counters().unloaded, 1u);

    world.receive(1, ControlMessage(OpenLayer{9, kA, 0}));
    world.load();
    EXPECT_EQ(world.nextControl<LayerOpened>(1).request, 9u);
    EXPECT_EQ(*world.project->layer(kA), World::sample());
}

TEST(ProjectUnloading, ALayerStaysForAWhileIfThereIsRoom) {
    World world;
    world.join(1);
    open(world, 1);
    world.receive(1, ControlMessage(CloseLayer{kA}));
    world.host.nowMs += world.options.idleLayerMs - 1;
    world.project->unloadIdle();
    EXPECT_NE(world.project->layer(kA), nullptr);
    world.host.nowMs += 1;
    world.project->unloadIdle();
    EXPECT_EQ(world.project->layer(kA), nullptr);
}

TEST(ProjectUnloading, TheLayerThatWasClosedFirstIsUnloadedFirst) {
    Project::Options options;
    options.idleLayerBytes = 3'000;  // enough for one layer of four specs
    World world(options);
    world.join(1);
    open(world, 1, kB);
    open(world, 1, kA);
    world.receive(1, ControlMessage(CloseLayer{kA}));
    world.receive(1, ControlMessage(CloseLayer{kB}));
    EXPECT_EQ(world.project->layer(kA), nullptr);
    EXPECT_NE(world.project->layer(kB), nullptr);
}

TEST(ProjectUnloading, ALayerThatIsNotDurableStays) {
    World world(atOnce());
    world.join(1);
    open(world, 1);
    world.submit(1, 1, {create("/C")});
    world.receive(1, ControlMessage(CloseLayer{kA}));
    EXPECT_NE(world.project->layer(kA), nullptr);
    world.store();
    EXPECT_EQ(world.project->layer(kA), nullptr);
}

TEST(ProjectUnloading, ALayerThatARequestWaitsForStays) {
    World world(atOnce());
    world.join(1);
    open(world, 1);
    world.submit(1, 1, {create("/C"), create("/C", kB)});  // waits for the other layer
    world.receive(1, ControlMessage(CloseLayer{kA}));
    EXPECT_NE(world.project->layer(kA), nullptr);
    world.receive(1, ControlMessage(SaveLayers{2, {kA, kB}, {}}));
    world.load();
    EXPECT_EQ(world.host.appending.size(), 1u);
    world.store();
    ASSERT_EQ(world.host.saves.size(), 1u);
    EXPECT_TRUE(world.host.saves[0].jobs[0].doc.has("/C"));
    EXPECT_EQ(world.project->layer(kA), nullptr);
    EXPECT_EQ(world.project->layer(kB), nullptr);
}

// The state of a layer is known without its content.
TEST(ProjectUnloading, StatesStay) {
    World world(atOnce());
    world.join(1);
    Hello hello = world.hello(1);
    open(world, 1, kA, true);
    std::vector<Edit> edits;
    for (EditAction& action : lockEdits(*world.project->layer(kA), LayerLock{true, {"user1"}, 5}))
        edits.push_back({kA, {"/", {}}, std::move(action)});
    world.submit(1, 1, std::move(edits));
    world.store();
    world.receive(1, ControlMessage(CloseLayer{kA}));
    ASSERT_EQ(world.project->layer(kA), nullptr);

    Hello watching = world.hello(2);
    watching.features = {"states"};
    world.connect(2, watching);
    world.nextControl<Welcome>(2);
    const auto states = world.nextControl<LayerStates>(2);
    ASSERT_EQ(states.layers.size(), 1u);
    EXPECT_TRUE(states.layers[0].dirty);
    EXPECT_TRUE(states.layers[0].locked);
    EXPECT_EQ(states.layers[0].holder, UserName{"user1"});
    EXPECT_TRUE(states.layers[0].editors.empty());

    // A scan of the folder from before the store had the layer does not remove it.
    world.project->setFiles({{kB}});
    world.receive(2, ControlMessage(SaveLayers{3, {}, {}}));
    EXPECT_EQ(world.host.loading, std::deque<LayerId>{kA});
}

// LK1: a preview of a locked layer is not passed on, whether the layer is loaded or not.
TEST(ProjectUnloading, LK1NoPreviewOfAnUnloadedLayerThatIsLocked) {
    World world(atOnce());
    world.join(1);
    world.join(2);
    open(world, 1);
    std::vector<Edit> edits;
    for (EditAction& action : lockEdits(*world.project->layer(kA), LayerLock{true, {"user1"}, 5}))
        edits.push_back({kA, {"/", {}}, std::move(action)});
    world.submit(1, 1, std::move(edits));
    world.store();
    world.receive(1, ControlMessage(CloseLayer{kA}));
    ASSERT_EQ(world.project->layer(kA), nullptr);
    world.host.sent[1].clear();
    world.receive(2, Frame(PreviewFrame{{}, 1, 0, {set("/A.x", 1)}}));
    EXPECT_TRUE(world.silent(1));
}

}  // namespace
}  // namespace usdlive::server::projecttest
