// Tests addresses of layers that are live in this process.
#include "LiveProjects.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <fstream>

using namespace usdlive::resolver;
namespace fs = std::filesystem;

namespace {

class LiveProjectsTest : public ::testing::Test {
protected:
    LiveProjectsTest() {
        fs::create_directories(folder / "sets");
        for (const char* name : {".hidden", ".usdlive-lost", "sets/.usdlive"})
            fs::create_directories(folder / name);
        for (const char* name : {"shot.usda", "sets/wall.usdc", ".hidden/a.usda", "brick.png",
                                 ".usdlive-lost/a.usda", "sets/.usdlive/a.usda"})
            std::ofstream(folder / name) << "#usda 1.0\n";
    }
    ~LiveProjectsTest() override { fs::remove_all(folder); }

    static Url address(const std::string& token, const std::string& path,
                       const std::string& server = "usdlive://localhost:7447") {
        return *parseUrl(server + "/@~" + token + "/" + path);
    }

    const fs::path folder =
        fs::temp_directory_path() / ("usdlive-live-projects-" + std::to_string(getpid()));
    LiveProjects projects;
};

}  // namespace

TEST(LiveUrl, KeepsItsTokenInBothTextsAndInWhatIsBesideIt) {
    const std::string text = "usdlive://localhost:7447/@~live2/sets/wall.usda";
    const auto url = parseUrl(text);
    ASSERT_TRUE(url && url->isLive());
    EXPECT_EQ(url->identifier(), text);
    EXPECT_EQ(url->resolvedPath(), text);
    EXPECT_EQ(anchored(*url, "../tex/a.<UDIM>.png").identifier(),
              "usdlive://localhost:7447/@~live2/tex/a.<UDIM>.png");
    EXPECT_FALSE(parseUrl("usdlive://localhost/@~12-ab/shot.usda")->isLive());
}

TEST_F(LiveProjectsTest, OneConnectionAndFolderHaveOneToken) {
    const std::string first = projects.add("localhost:7447", "", folder.string());
    EXPECT_EQ(first, "live");
    EXPECT_EQ(projects.add("LOCALHOST", "", folder.string()), first);
    EXPECT_EQ(projects.add("localhost:7447", "shots/", folder.string()), std::string("live2"));
    EXPECT_EQ(projects.add("localhost:7447", "", "/elsewhere"), std::string("live3"));
    EXPECT_EQ(projects.add("a host:7447", "", folder.string()), nullptr);
}

TEST_F(LiveProjectsTest, LayersArePlaceholdersAndNothingElseIs) {
    const std::string token = projects.add("localhost:7447", "shots/", folder.string());
    const auto file = [&](const std::string& path) {
        const auto live = projects.find(address(token, path));
        return live ? live->layerFile(address(token, path)) : std::nullopt;
    };
    EXPECT_EQ(file("shots/shot.usda"), folder / "shot.usda");
    EXPECT_EQ(file("shots/sets/wall.usdc"), folder / "sets/wall.usdc");
    EXPECT_EQ(file("shots/.hidden/a.usda"), folder / ".hidden/a.usda") << "LN1 allows the name";
    for (const char* path :
         {"shot.usda", "shots/none.usda", "shots/brick.png", "shots/.usdlive-lost/a.usda",
          "shots/sets/.usdlive/a.usda", "shots/../../shot.usda", "shots/sets", "other/shot.usda"})
        EXPECT_FALSE(file(path)) << path;
}

TEST_F(LiveProjectsTest, TokensOfOtherServersAndProcessesAreNotLive) {
    const std::string token = projects.add("localhost:7447", "", folder.string());
    EXPECT_TRUE(projects.find(address(token, "shot.usda")));
    EXPECT_FALSE(projects.find(address(token, "shot.usda", "usdlive://localhost:7448")));
    EXPECT_FALSE(projects.find(address("live99", "shot.usda")));
    EXPECT_FALSE(projects.find(*parseUrl("usdlive://localhost:7447/shot.usda")));
}

TEST_F(LiveProjectsTest, AddressesStayWhenTheServerMoves) {
    const std::string token = projects.add("localhost:7447", "", folder.string());
    projects.setConnected(token, "", false);
    EXPECT_FALSE(projects.findToken(token)->isConnected);
    projects.setConnected(token, "localhost:8000", true);
    const auto live = projects.find(address(token, "shot.usda"));
    ASSERT_TRUE(live && live->isConnected);
    EXPECT_EQ(live->atServer(address(token, "a.png")).port, 8000);
}

TEST_F(LiveProjectsTest, APackageIsFoundAtTheServerOfItsLiveProject) {
    const std::string first = projects.add("localhost:7447", "shots/", folder.string());
    const std::string second = projects.add("localhost:7447", "shots/", "/elsewhere");
    const auto at = [&](const std::string& path) {
        return projects.findAt(*parseUrl("usdlive://localhost:7447/" + path));
    };
    projects.setConnected(first, "", false);
    projects.setConnected(second, "localhost:8000", true);
    ASSERT_TRUE(at("shots/car.usdz"));
    EXPECT_EQ(at("shots/car.usdz")->port, 8000) << "one that is connected";
    EXPECT_FALSE(at("other/car.usdz"));
    EXPECT_FALSE(projects.findAt(*parseUrl("usdlive://localhost:7448/shots/car.usdz")));
    projects.close(second);
    EXPECT_FALSE(at("shots/car.usdz")->isConnected);
    projects.close(first);
    EXPECT_FALSE(at("shots/car.usdz")) << "nothing is live there";
    EXPECT_EQ(projects.add("localhost:7447", "shots/", folder.string()), first);
    EXPECT_TRUE(at("shots/car.usdz"));
}

TEST_F(LiveProjectsTest, ATickNeedsAFileUntilItsContentHasCome) {
    const std::string token = projects.add("localhost:7447", "", folder.string());
    const auto tick = projects.findToken(token)->tick;
    EXPECT_FALSE(tick->isRunning());
    tick->begin();
    EXPECT_TRUE(tick->isRunning());
    for (const char* path : {"b.usdz", "a.usdz", "b.usdz"}) tick->need(path);
    EXPECT_EQ(tick->end(), (std::set<std::string>{"a.usdz", "b.usdz"}));
    EXPECT_FALSE(tick->isRunning());
    EXPECT_TRUE(tick->end().empty());
    tick->fetched("b.usdz", "12ab", false);
    EXPECT_TRUE(tick->wasFetched("b.usdz", "12ab"));
    EXPECT_FALSE(tick->wasFetched("b.usdz", "34cd"));
    EXPECT_FALSE(tick->wasFetched("a.usdz", "12ab"));
    tick->fetched("b.usdz", "12ab", true);
    EXPECT_FALSE(tick->wasFetched("b.usdz", "12ab")) << "the cache has it";
    projects.setConnected(token, "localhost:7448", true);
    EXPECT_EQ(projects.findToken(token)->tick, tick) << "it stays when the project changes";
}

// Otherwise a cache that is too small would fetch the same files for ever.
TEST_F(LiveProjectsTest, ATickGivesUpAFileThatTheCacheDoesNotKeep) {
    const std::string token = projects.add("localhost:7447", "", folder.string());
    const auto tick = projects.findToken(token)->tick;
    const auto isNeeded = [&] {
        tick->need("a.usdz");
        return !tick->end().empty();
    };
    for (int time = 0; time < 3; ++time) {
        EXPECT_TRUE(isNeeded());
        tick->fetched("a.usdz", "12ab", true);
    }
    EXPECT_FALSE(isNeeded());
    tick->found("a.usdz");
    EXPECT_TRUE(isNeeded());
}

TEST_F(LiveProjectsTest, AProjectThatIsOpenedAgainHasNoLayersThatAreFiles) {
    const std::string token = projects.add("localhost:7447", "", folder.string());
    const auto url = *parseUrl("usdlive://localhost:7447/@~" + token + "/clip.usda");
    projects.findToken(token)->fileLayers->set("clip.usda", true);
    EXPECT_TRUE(projects.find(url)->isFileLayer(url));
    projects.setConnected(token, "localhost:7448", true);
    EXPECT_TRUE(projects.find(url)->isFileLayer(url));
    projects.close(token);
    EXPECT_EQ(projects.add("localhost:7447", "", folder.string()), token);
    EXPECT_FALSE(projects.find(url)->isFileLayer(url));
}

TEST(FileLayers, ThoseThatWereOpenedWithAnotherContentHaveChanged) {
    FileLayers layers;
    for (const char* path : {"a.usda", "b.usda", "c.usda"}) layers.set(path, true);
    Snapshot now;
    now.files["a.usda"] = {"5-0123456789abcdef0", "", 0};
    now.files["b.usda"] = {"", std::string(64, 'b'), 2'000};
    now.files["c.usda"] = {"7-0123456789abcdef0", "", 0};
    EXPECT_TRUE(layers.changedIn(now).empty()) << "none was opened";
    EXPECT_FALSE(layers.timeOf("a.usda"));
    layers.opened("a.usda", now.files["a.usda"].content(), 5);
    layers.opened("b.usda", std::string(64, 'a'), 1);
    EXPECT_EQ(layers.timeOf("b.usda"), 1);
    EXPECT_EQ(layers.changedIn(now), std::vector<std::string>{"b.usda"});
    EXPECT_TRUE(layers.changedIn(now).empty()) << "it was reported";
}
