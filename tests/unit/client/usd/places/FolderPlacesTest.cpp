// Tests the places of layers in a process: the cache folder and project folders.
#include "usd/places/FolderPlaces.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <fstream>
#include <thread>

using namespace usdlive;
using namespace usdlive::client;
namespace fs = std::filesystem;

namespace {

class FolderPlacesTest : public ::testing::Test {
protected:
    FolderPlacesTest() {
        fs::remove_all(root);
        fs::create_directories(root / "project/shot");
        std::ofstream(root / "project/shot/anim.usda") << "#usda 1.0\n(\n \"theirs\"\n)\n";
    }
    ~FolderPlacesTest() override { fs::remove_all(root); }

    std::unique_ptr<CacheFolderPlaces> cache() {
        return std::move(*CacheFolderPlaces::create(root / "cache", worker));
    }
    std::unique_ptr<FolderPlaces> projectFolder() {
        return std::move(*FolderPlaces::create(root / "project"));
    }

    const fs::path root =
        fs::canonical(fs::temp_directory_path()) / ("usdlive-places-" + std::to_string(getpid()));
    const LayerId anim{"shot/anim.usda"}, look{"look.usdc"};
    Worker worker;
};

}  // namespace

TEST_F(FolderPlacesTest, IdentifierAndLayerAreTheWayBackOfOneAnother) {
    const auto places = cache();
    const auto identifier = places->identifierOf(anim);
    EXPECT_EQ(identifier, (root / "cache/shot/anim.usda").string());
    EXPECT_EQ(places->layerAt(identifier), anim);
    EXPECT_EQ(places->layerAt((root / "cache/x/../shot/./anim.usda").string()), anim);
    for (const std::string& other :
         {std::string(), std::string("shot/anim.usda"), (root / "cache").string(),
          (root / "cache/../secret.usda").string(), (root / "cachex/shot/anim.usda").string()})
        EXPECT_FALSE(places->layerAt(other)) << other;
}

TEST_F(FolderPlacesTest, TheCacheFolderMakesLayersFindable) {
    const auto places = cache();
    EXPECT_FALSE(pxr::SdfLayer::FindOrOpen(places->identifierOf(look)));
    EXPECT_EQ(places->makeFindable(look), true);
    EXPECT_EQ(places->makeFindable(look), false) << "it is there already";
    {
        const auto layer = pxr::SdfLayer::FindOrOpen(places->identifierOf(look));
        ASSERT_TRUE(layer);
        EXPECT_EQ(places->layerOf(layer), look);
    }
    places->remove(look);
    EXPECT_FALSE(pxr::SdfLayer::FindOrOpen(places->identifierOf(look)));
}

TEST_F(FolderPlacesTest, ManyLayersAreMadeFindableBesideTheFrame) {
    const auto places = cache();
    std::vector<LayerId> many;
    for (int i = 0; i < 300; ++i) many.push_back({"many/" + std::to_string(i) + ".usda"});
    places->add(many, 0);
    for (int i = 0; i < 10'000 && !places->isComplete(); ++i)
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
    ASSERT_TRUE(places->isComplete());
    for (const LayerId& id : many) EXPECT_TRUE(fs::exists(places->identifierOf(id)));
    EXPECT_FALSE(places->takeError());
}

TEST_F(FolderPlacesTest, AProjectFolderIsLeftAsItIs) {
    const auto places = projectFolder();
    EXPECT_EQ(places->makeFindable(look), false);
    EXPECT_FALSE(fs::exists(root / "project/look.usdc"));
    places->remove(anim);
    EXPECT_TRUE(fs::exists(root / "project/shot/anim.usda"));
    EXPECT_EQ(FolderPlaces::create(root / "nothing").error().code, ErrorCode::InvalidArgument);
}

TEST_F(FolderPlacesTest, LayersOfAllPlacesAreRecognizedAndOpenedAtTheFirst) {
    AllPlaces places(cache());
    places.attach(projectFolder());
    places.attach(projectFolder());
    EXPECT_EQ(places.identifierOf(anim), (root / "cache/shot/anim.usda").string());
    EXPECT_EQ(places.layerAt((root / "project/shot/anim.usda").string()), anim);
    const auto theirs = pxr::SdfLayer::FindOrOpen((root / "project/shot/anim.usda").string());
    ASSERT_TRUE(theirs);
    EXPECT_EQ(places.layerOf(theirs), anim);
    EXPECT_EQ(places.identifierBeside(theirs, look), (root / "project/look.usdc").string());
    const auto elsewhere = pxr::SdfLayer::CreateAnonymous(".usda");
    EXPECT_EQ(places.identifierBeside(elsewhere, look), (root / "cache/look.usdc").string());
}

TEST_F(FolderPlacesTest, ACacheFolderThatCannotBeIsAnError) {
    std::ofstream(root / "file") << "x";
    const auto made = CacheFolderPlaces::create(root / "file/cache", worker);
    ASSERT_FALSE(made);
    EXPECT_EQ(made.error().code, ErrorCode::InvalidArgument);
}
