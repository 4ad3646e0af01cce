// Whatever is in the layers, and whatever becomes of them: errors name layer and path, and the
// stage stays usable.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <pxr/base/tf/errorMark.h>
#include <pxr/usd/sdf/attributeSpec.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/primSpec.h>
#include <pxr/usd/sdf/reference.h>
#include <pxr/usd/sdf/relationshipSpec.h>

#include <filesystem>
#include <string>

#include "usdlive/client/usd/stage/Stage.h"

namespace usdlive::stage {
namespace {

using pxr::SdfLayer;
using pxr::SdfLayerRefPtr;
using pxr::SdfPath;
using pxr::TfToken;
using testing::HasSubstr;

SdfLayerRefPtr badLayer(const std::string& text) {
    auto layer = SdfLayer::CreateAnonymous(".usda");
    EXPECT_TRUE(layer->ImportFromString("#usda 1.0\n" + text)) << text;
    return layer;
}

// An edit is followed, and shown.
void expectUsable(Stage& stage, const SdfLayerRefPtr& layer) {
    const SdfPath path("/Usable/Child");
    pxr::SdfCreatePrimInLayer(layer, path)->SetSpecifier(pxr::SdfSpecifierDef);
    EXPECT_TRUE(stage.prim(path));
    EXPECT_FALSE(stage.traverse(PrimPredicate::all()).empty());
}

SdfPath pathOfDepth(int depth) {
    SdfPath path = SdfPath::AbsoluteRootPath();
    const TfToken name("d");
    for (int i = 0; i < depth; ++i) path = path.AppendChild(name);
    return path;
}

TEST(StageBadInput, ErrorsNameTheLayerAndThePrim) {
    struct Case {
        const char *content, *type, *prim;
    };
    for (const auto& [content, type, prim] : {
             Case{"def \"A\" (\n references = </A>\n) {\n}\n", "ArcCycle", "/A"},
             Case{"def \"A\" (\n references = </B>\n) {\n}\ndef \"B\" (\n references = </A>\n) "
                  "{\n}\n",
                  "ArcCycle", "/A"},
             Case{"class \"A\" (\n inherits = </B>\n) {\n}\nclass \"B\" (\n inherits = </A>\n) "
                  "{\n}\n",
                  "ArcCycle", "/A"},
             Case{"def \"A\" (\n specializes = </A>\n) {\n}\n", "ArcCycle", "/A"},
             Case{"def \"A\" {\n def \"B\" (\n references = </A>\n) {\n}\n}\n", "ArcCycle", "/A/B"},
             Case{"def \"A\" (\n references = @./gone.usda@\n) {\n}\n", "InvalidAssetPath", "/A"},
             Case{"def \"A\" (\n payload = </Gone>\n) {\n}\n", "UnresolvedPrimPath", "/A"},
         }) {
        SCOPED_TRACE(content);
        const auto layer = badLayer(content);
        Stage stage(layer);
        const auto errors = stage.errors();
        ASSERT_FALSE(errors.empty());
        EXPECT_EQ(errors.front().type, type);
        EXPECT_EQ(errors.front().prim, SdfPath(prim));
        EXPECT_THAT(errors.front().message, HasSubstr(prim));
        EXPECT_THAT(errors.front().message, HasSubstr(layer->GetIdentifier()));
        expectUsable(stage, layer);
    }
}

TEST(StageBadInput, AMillionDeepPathIsOnlyAPathThatIsNotThere) {
    const auto layer = badLayer("def \"A\" {\n rel r\n}\n");
    Stage stage(layer);
    const SdfPath deep = pathOfDepth(1'000'000);
    layer->GetRelationshipAtPath(SdfPath("/A.r"))->GetTargetPathList().Prepend(deep);
    EXPECT_FALSE(stage.prim(deep));
    EXPECT_FALSE(stage.property(deep.AppendProperty(TfToken("x"))));
    EXPECT_EQ(stage.property(SdfPath("/A.r")).targets(), pxr::SdfPathVector{deep});
    stage.unload(deep);
    stage.setMask(PopulationMask({deep, SdfPath("/A")}));
    stage.setMask({});
    expectUsable(stage, layer);
}

TEST(StageBadInput, TextThatIsNotUtf8IsAValueLikeAnyOther) {
    const auto layer = badLayer("def \"A\" {\n string s\n asset f\n}\n");
    Stage stage(layer);
    const std::string text("\xff\xfe\xc3(");
    layer->GetAttributeAtPath(SdfPath("/A.s"))->SetDefaultValue(pxr::VtValue(text));
    EXPECT_EQ(stage.property(SdfPath("/A.s")).value(), pxr::VtValue(text));
    pxr::TfErrorMark mark;
    layer->GetPrimAtPath(SdfPath("/A"))->GetReferenceList().Prepend({text + ".usda", SdfPath()});
    mark.Clear();
    EXPECT_FALSE(stage.errors().empty());
    expectUsable(stage, layer);
}

TEST(StageBadInput, PathsThatAreNoneHaveNoPrims) {
    const auto layer = badLayer("def \"A\" {\n}\n");
    Stage stage(layer);
    for (const SdfPath& path :
         {SdfPath(), SdfPath("A"), SdfPath("/A{v=x}"), SdfPath("/A.x"), SdfPath("..")}) {
        EXPECT_FALSE(stage.prim(path)) << path;
        stage.load(path);
        EXPECT_TRUE(stage.editTarget().specPath(path).IsEmpty() || !path.IsEmpty());
    }
    pxr::TfErrorMark mark;
    EXPECT_FALSE(stage.prim(SdfPath("/A")).child(TfToken("1 bad")));
    EXPECT_FALSE(stage.prim(SdfPath("/A")).property(TfToken("")));
    mark.Clear();
    expectUsable(stage, layer);
}

TEST(StageBadInput, LayersThatVanishLeaveTheRestUsable) {
    const std::filesystem::path folder = std::filesystem::temp_directory_path() / "usdlive_vanish";
    std::filesystem::create_directories(folder);
    const auto write = [&](const char* name, const std::string& text) {
        badLayer(text)->Export((folder / name).string());
    };
    write("sub.usda", "def \"S\" {\n}\n");
    write("asset.usda", "def \"M\" {\n    def \"Part\" {\n    }\n}\n");
    write("root.usda",
          "(\n    subLayers = [@./sub.usda@]\n)\ndef \"A\" (\n    references = "
          "@./asset.usda@</M>\n) {\n}\n");
    auto opened = Stage::open((folder / "root.usda").string());
    ASSERT_TRUE(opened);
    auto& stage = **opened;
    const auto root = SdfLayerRefPtr(stage.rootLayer());
    ASSERT_TRUE(stage.prim(SdfPath("/A/Part")) && stage.prim(SdfPath("/S")));

    std::filesystem::remove_all(folder);
    EXPECT_TRUE(stage.prim(SdfPath("/A/Part"))) << "layers that are open stay";
    expectUsable(stage, root);
    {
        pxr::TfErrorMark mark;
        for (const auto& layer : stage.usedLayers()) (void)layer->Reload(true);
        mark.Clear();
    }
    expectUsable(stage, root);
    for (const auto& layer : stage.usedLayers())
        if (layer->GetDisplayName() == "asset.usda") layer->Clear();
    EXPECT_FALSE(stage.prim(SdfPath("/A/Part")));
    EXPECT_FALSE(stage.errors().empty());
    expectUsable(stage, root);
}

TEST(StageBadInput, AnEditTargetWhoseLayerIsGoneReachesNothing) {
    const auto layer = badLayer("def \"A\" {\n}\n");
    Stage stage(layer);
    auto other = SdfLayer::CreateAnonymous(".usda");
    const auto target = EditTarget::inVariant(other, SdfPath("/A{v=x}"));
    stage.setEditTarget(target);
    other.Reset();
    EXPECT_FALSE(stage.editTarget().isValid());
    EXPECT_FALSE(stage.editTarget().primSpec(SdfPath("/A")));
    expectUsable(stage, layer);
}

}  // namespace
}  // namespace usdlive::stage
