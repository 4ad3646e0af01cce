// Tests the operations on layers and sublayers.
#include "usdlive/client/usd/layers/LayerUtils.h"

#include <pxr/usd/sdf/assetPath.h>
#include <pxr/usd/sdf/reference.h>

#include "LayersFixture.h"

namespace usdlive::layers {

namespace fs = std::filesystem;
namespace utils = LayerUtils;

class LayerUtilsTest : public LayersFixture {
protected:
    LayerUtilsTest() {
        fs::remove_all(folder);
        fs::create_directories(folder / "below");
    }
    ~LayerUtilsTest() override { fs::remove_all(folder); }

    const fs::path folder = fs::temp_directory_path() / "usdlive-layer-utils";
};

TEST_F(LayerUtilsTest, SublayersAreMadeWherePositionsSay) {
    EXPECT_FALSE(utils::createSublayer(root, -2, ""));
    const auto last = utils::createSublayer(root, -1, "");
    ASSERT_TRUE(last);
    EXPECT_EQ(utils::sublayerPosition(root, last->GetIdentifier()), 2);
    const auto past = utils::createSublayer(root, 99, "");
    EXPECT_EQ(utils::sublayerPosition(root, past->GetIdentifier()), 3);
    const auto first = utils::createSublayer(root, 0, "");
    EXPECT_EQ(utils::sublayerIdentifier(root, 0), first->GetIdentifier());
    EXPECT_EQ(utils::removeSublayer(root, 0), first->GetIdentifier());
    EXPECT_EQ(utils::removeSublayer(root, 99), "");
    EXPECT_EQ(utils::sublayerPosition(root, "nowhere.usda"), -1);
    EXPECT_FALSE(utils::createSublayer({}, 0, ""));
}

TEST_F(LayerUtilsTest, AnExistingFileIsEmptiedAndNamedRelative) {
    const auto top = pxr::SdfLayer::CreateNew((folder / "top.usda").string());
    const auto old = pxr::SdfLayer::CreateNew((folder / "below" / "old.usda").string());
    define(old, "/Old");
    ASSERT_TRUE(old->Save());
    const auto made = utils::createSublayer(top, -1, old->GetIdentifier());
    ASSERT_TRUE(made);
    EXPECT_FALSE(has(made, "/Old"));
    EXPECT_EQ(std::string(top->GetSubLayerPaths()[0]), "./below/old.usda");
    EXPECT_FALSE(utils::insertSublayer(top, 0, (folder / "nowhere.usda").string()));
    EXPECT_FALSE(utils::insertSublayer(top, 0, made->GetIdentifier())) << "it is there";
    EXPECT_FALSE(utils::insertSublayer(made, 0, top->GetIdentifier())) << "a circle";
    EXPECT_FALSE(utils::insertSublayer(top, 0, top->GetIdentifier()));
}

TEST_F(LayerUtilsTest, DirtyLayersAreThoseOfTheTreeThatHaveAFile) {
    const auto top = pxr::SdfLayer::CreateNew((folder / "top.usda").string());
    const auto below = utils::createSublayer(top, -1, (folder / "below" / "sub.usda").string());
    define(utils::createSublayer(below, -1, ""), "/Anonymous");
    ASSERT_TRUE(below->Save());
    ASSERT_TRUE(top->Save());
    EXPECT_FALSE(utils::hasDirtyLayers(top));
    define(below, "/New");
    EXPECT_EQ(utils::localDirtyLayers(top), std::vector{below->GetIdentifier()});
    define(top, "/New");
    EXPECT_EQ(utils::localDirtyLayers(top),
              (std::vector{top->GetIdentifier(), below->GetIdentifier()}));
    EXPECT_TRUE(utils::hasDirtyLayers(top));
    EXPECT_FALSE(utils::hasDirtyLayers({}));
}

TEST_F(LayerUtilsTest, PrimSpecsAreVisitedParentsFirstAlsoInVariants) {
    define(weak, "/A");
    define(weak, "/A/B");
    define(weak, "/A{look=red}C");
    define(weak, "/Z");
    const auto visited = [&](const std::string& from, std::size_t most) {
        std::vector<std::string> paths;
        utils::iteratePrimSpecs(weak, pxr::SdfPath(from), [&](const auto& spec) {
            paths.push_back(spec->GetPath().GetString());
            return paths.size() < most;
        });
        return paths;
    };
    using Paths = std::vector<std::string>;
    EXPECT_EQ(visited("/", 99), (Paths{"/A", "/A/B", "/A{look=red}", "/A{look=red}C", "/Z"}));
    EXPECT_EQ(visited("/A/B", 99), Paths{"/A/B"});
    EXPECT_EQ(visited("/", 3).size(), 3u);
    EXPECT_TRUE(visited("/Nowhere", 99).empty());
}

TEST_F(LayerUtilsTest, MovedAndReplacedSublayersKeepTheirOffsets) {
    root->SetSubLayerOffset(pxr::SdfLayerOffset(7), 1);
    ASSERT_TRUE(utils::moveLayer(root, 1, root, 0));
    EXPECT_EQ(utils::sublayerIdentifier(root, 0), weak->GetIdentifier());
    EXPECT_EQ(root->GetSubLayerOffset(0).GetOffset(), 7);
    EXPECT_FALSE(utils::moveLayer(root, 0, weak, 0)) << "into itself";
    ASSERT_TRUE(utils::moveLayer(root, 0, strong, -1, true));
    EXPECT_EQ(root->GetNumSubLayerPaths(), 1u);
    EXPECT_EQ(utils::allSublayers(root),
              (std::vector{strong->GetIdentifier(), weak->GetIdentifier()}));
    EXPECT_TRUE(utils::isInSublayerTree(root, weak->GetIdentifier()));
    const auto other = pxr::SdfLayer::CreateAnonymous("other.usda");
    ASSERT_TRUE(utils::replaceSublayer(strong, 0, other->GetIdentifier()));
    EXPECT_EQ(strong->GetSubLayerOffset(0).GetOffset(), 7);
    EXPECT_FALSE(utils::replaceSublayer(strong, 5, other->GetIdentifier()));
}

TEST_F(LayerUtilsTest, AssetPathsMeanTheSameInAnotherFolder) {
    const auto from = pxr::SdfLayer::CreateNew((folder / "from.usda").string());
    const auto to = pxr::SdfLayer::CreateNew((folder / "below" / "to.usda").string());
    define(from, "/A");
    const pxr::SdfPath path("/A.asset");
    pxr::SdfJustCreatePrimAttributeInLayer(from, path, pxr::SdfValueTypeNames->Asset);
    from->SetField(path, pxr::SdfFieldKeys->Default, pxr::SdfAssetPath("./textures/a.png"));
    from->GetPrimAtPath(pxr::SdfPath("/A"))
        ->GetReferenceList()
        .Prepend(pxr::SdfReference("./a.usda", pxr::SdfPath("/X")));
    ASSERT_TRUE(utils::transferContent(from, to));
    EXPECT_EQ(
        to->GetField(path, pxr::SdfFieldKeys->Default).Get<pxr::SdfAssetPath>().GetAssetPath(),
        "../textures/a.png");
    const pxr::SdfReference reference =
        to->GetPrimAtPath(pxr::SdfPath("/A"))->GetReferenceList().GetPrependedItems()[0];
    EXPECT_EQ(reference.GetAssetPath(), "../a.usda");
    EXPECT_FALSE(utils::transferContent(from, from));
}

TEST_F(LayerUtilsTest, PrimSpecsAndNames) {
    define(weak, "/A/B");
    EXPECT_TRUE(utils::hasPrimSpec(weak, pxr::SdfPath("/A/B")));
    EXPECT_TRUE(utils::hasRootPrimSpecs(weak));
    EXPECT_TRUE(utils::removePrimSpec(weak, pxr::SdfPath("/A/B")));
    EXPECT_FALSE(utils::removePrimSpec(weak, pxr::SdfPath("/A/B")));
    EXPECT_FALSE(utils::removePrimSpec(weak, pxr::SdfPath()));
    EXPECT_TRUE(utils::setCustomLayerName(weak, "name"));
    EXPECT_EQ(utils::customLayerName(weak), "name");
    EXPECT_EQ(utils::normalizeUrl("/a/./b/../c.usda"), "/a/c.usda");
    EXPECT_EQ(utils::normalizeUrl("http://host/a/../c.usda"), "http://host/c.usda");
    std::vector<std::string> failed;
    EXPECT_FALSE(utils::saveLayers({"/nowhere.usda"}, &failed));
    EXPECT_EQ(failed.size(), 1u);
}

}  // namespace usdlive::layers
