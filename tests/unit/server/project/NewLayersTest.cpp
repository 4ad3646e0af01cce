// Tests new layers of the project (FI6), and notices about the progress of long requests (PG1).
#include <gtest/gtest.h>

#include "FakeHost.h"

namespace usdlive::server::projecttest {
namespace {

const LayerId kNew{"fx.usda"};

class NewLayers : public ::testing::Test {
protected:
    NewLayers() {
        for (const SessionId session : {1, 2}) world.join(session);
    }
    void ask(const LayerId& layer = kNew) {
        world.receive(1, ControlMessage(CreateLayer{5, layer}));
    }
    std::string refusal() { return world.nextControl<ErrorMessage>(1).code; }
    World world;
};

TEST_F(NewLayers, FI6EverybodyIsNotifiedBeforeItsAuthorIsAnswered) {
    ask();
    ASSERT_EQ(world.host.creating.size(), 1u);
    EXPECT_TRUE(world.silent(1));
    world.project->layerCreated(1, 5, kNew, {});
    const ProjectLayers now{{{{"a.usda"}}, {{"b.usda"}}, {kNew}}};
    EXPECT_EQ(world.nextControl<ProjectLayers>(2), now);
    EXPECT_EQ(world.nextControl<ProjectLayers>(1), now);
    EXPECT_EQ(world.nextControl<LayerCreated>(1), (LayerCreated{5, kNew}));
    // The store loads it at once, whatever the last scan of the folder found.
    EXPECT_EQ(world.host.loading, std::deque{kNew});
    world.load(true);
    EXPECT_EQ(world.host.appending.size(), 1u);
    world.project->setFiles({{{"a.usda"}}, {{"b.usda"}}});
    world.receive(2, ControlMessage(OpenLayer{6, kNew, 0}));
    EXPECT_TRUE(world.host.loading.empty()) << "it is still there";
    EXPECT_EQ(world.host.logged.back(), "user1: layer created fx.usda");
}

TEST_F(NewLayers, FI6AnExistingLayerOrOneThatCannotBeStoredIsNotCreated) {
    ask({"a.usda"});
    EXPECT_EQ(refusal(), errorName(ErrorCode::LayerExists));
    world.project->setSpace(false);
    ask();
    EXPECT_EQ(refusal(), errorName(ErrorCode::StorageFull));
    world.project->setSpace(true);
    world.project->storeClosed();
    ask();
    EXPECT_EQ(refusal(), errorName(ErrorCode::StorageFailed));
    EXPECT_TRUE(world.host.creating.empty());
}

TEST_F(NewLayers, FI6AFolderThatTakesNoFileSaysWhyAndChangesNothing) {
    ask();
    world.project->layerCreated(1, 5, kNew, fail(ErrorCode::SaveFailed, "read-only"));
    const auto refused = world.nextControl<ErrorMessage>(1);
    EXPECT_EQ(refused.code, errorName(ErrorCode::SaveFailed));
    EXPECT_EQ(refused.request, 5u);
    EXPECT_TRUE(world.silent(2));
    EXPECT_TRUE(world.host.loading.empty());
}

TEST_F(NewLayers, FI6TheLayerIsCreatedAlsoIfItsAuthorLeft) {
    ask();
    world.project->disconnected(1);
    world.project->layerCreated(1, 5, kNew, {});
    EXPECT_EQ(world.nextControl<ProjectLayers>(2).layers.size(), 3u);
    EXPECT_EQ(world.host.loading, std::deque{kNew});
}

TEST_F(NewLayers, PG1TheRequesterIsNotifiedOfTheProgress) {
    Hello hello = world.hello(3);
    hello.features = {"progress"};
    world.connect(3, hello);
    world.host.sent.clear();
    for (const SessionId session : {1, 3})
        world.receive(session, ControlMessage(OpenLayer{9, {"a.usda"}, 0}));
    world.project->layerNotStored({"a.usda"});
    EXPECT_EQ(world.host.importing, std::deque<LayerId>{{"a.usda"}});
    world.project->layerBeingImported({"a.usda"});
    EXPECT_EQ(world.nextControl<RequestProgress>(3),
              (RequestProgress{9, "import", {"a.usda"}, 0, 0}));
    for (const SessionId session : {1, 3})
        world.project->layersBeingSaved(session, 10, {"a.usda"}, 3, 7);
    EXPECT_EQ(world.nextControl<RequestProgress>(3),
              (RequestProgress{10, "save", {"a.usda"}, 3, 7}));
    EXPECT_TRUE(world.silent(1)) << "the session does not have the feature";
    world.project->disconnected(3);
    world.project->layersBeingSaved(3, 10, {"a.usda"}, 4, 7);
    world.project->layerBeingImported({"not.usda"});
}

}  // namespace
}  // namespace usdlive::server::projecttest
