// Tests that texts for clients name no folder of the machine (FR12).
#include "project/PublicText.h"

#include <gtest/gtest.h>

#include "FakeHost.h"

namespace usdlive::server::projecttest {
namespace {

const PublicText kShown({"/home/ada/shot", "/mnt/disk/shot/", "/", ""});

TEST(PublicText, FilesAreNamedRelativeToTheProject) {
    EXPECT_EQ(kShown("cannot open /home/ada/shot/anim/a.usda: no such file"),
              "cannot open anim/a.usda: no such file");
    EXPECT_EQ(kShown("'/mnt/disk/shot/a.usda' and /home/ada/shot/b.usda"), "'a.usda' and b.usda");
}

TEST(PublicText, TheFolderItselfIsADot) {
    EXPECT_EQ(kShown("/home/ada/shot is not a folder"), ". is not a folder");
    EXPECT_EQ(kShown("in /home/ada/shot"), "in .");
}

TEST(PublicText, OtherTextsStay) {
    for (const char* text : {"", "</World/shot> of a.usda", "/home/ada/shots/a.usda", "50 %", "/"})
        EXPECT_EQ(kShown(text), text);
    EXPECT_EQ(PublicText()("/home/ada"), "/home/ada");
}

// Every way by which the error of a port reaches a client.
TEST(PublicText, NoMessageOfAProjectNamesItsFolder) {
    const std::string secret = "/home/ada/shot";
    const auto leaks = [&](ErrorCode code) {
        return fail(code, "cannot read " + secret + "/a.usda");
    };
    Project::Options options;
    options.texts = PublicText({secret});
    World world(options);
    world.join(1);
    world.receive(1, ControlMessage(OpenLayer{1, {"a.usda"}, 0}));
    world.project->layerLoaded({"a.usda"}, leaks(ErrorCode::LayerUnreadable));
    EXPECT_EQ(world.nextControl<ErrorMessage>(1).message, "cannot read a.usda");
    world.submit(1, 1, {create("/C")});
    world.project->layerLoaded({"a.usda"}, leaks(ErrorCode::LayerUnreadable));
    EXPECT_EQ(world.nextFrame<RefusalFrame>(1).error.message, "cannot read a.usda");
    world.receive(1, ControlMessage(SaveLayers{2, {{"a.usda"}}}));
    world.project->layerLoaded({"a.usda"}, leaks(ErrorCode::LayerUnreadable));
    EXPECT_EQ(world.nextControl<LayersSaved>(1).failed.at(0).message, "cannot read a.usda");
    world.receive(1, ControlMessage(OpenLayer{3, {"a.usda"}, 0}));
    world.load();
    world.host.sent.clear();
    world.submit(1, 2, {create("/C")});
    world.host.appending.clear();
    world.project->appendFailed(leaks(ErrorCode::StorageFull).value(), {});
    EXPECT_EQ(world.nextFrame<RefusalFrame>(1).error.message, "cannot read a.usda");
}

}  // namespace
}  // namespace usdlive::server::projecttest
