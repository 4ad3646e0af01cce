// Tests that bad input becomes errors that name layer and path, and that the stage stays usable.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <pxr/base/tf/errorMark.h>
#include <pxr/usd/sdf/attributeSpec.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/primSpec.h>
#include <pxr/usd/sdf/reference.h>
#include <pxr/usd/sdf/relationshipSpec.h>
#include <pxr/usd/sdf/schema.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>

#include "usdlive/client/usd/stage/Stage.h"

namespace usdlive::stage {
namespace {

using pxr::SdfLayer;
using pxr::SdfLayerRefPtr;
using pxr::SdfPath;
using pxr::TfToken;
using testing::AllOf;
using testing::ElementsAre;
using testing::Field;
using testing::HasSubstr;
using testing::IsEmpty;

SdfLayerRefPtr badLayer(const std::string& text) {
    auto layer = SdfLayer::CreateAnonymous(".usda");
    EXPECT_TRUE(layer->ImportFromString("#usda 1.0\n" + text)) << text;
    return layer;
}

// Expects that an edit is followed and shown, also after other input was refused.
void expectUsable(Stage& stage, const SdfLayerRefPtr& layer) {
    const SdfPath path("/Usable/Child");
    pxr::SdfCreatePrimInLayer(layer, path)->SetSpecifier(pxr::SdfSpecifierDef);
    EXPECT_TRUE(stage.prim(path));
    layer->GetPrimAtPath(path)->SetTypeName("Xform");
    EXPECT_EQ(stage.prim(path).typeName(), TfToken("Xform"));
    EXPECT_FALSE(stage.traverse(PrimPredicate::all()).empty());
}

SdfPath pathOfDepth(int depth) {
    SdfPath path = SdfPath::AbsoluteRootPath();
    const TfToken name("d");
    for (int i = 0; i < depth; ++i) path = path.AppendChild(name);
    return path;
}

// 65,536 and 65,541 elements: SdfPath counts them as 0 and 5.
constexpr int kDepths[] = {513, 30'000, 65'536, 65'541};

class TemporaryFolder {
public:
    TemporaryFolder() {
        std::string name = (std::filesystem::temp_directory_path() / "usdlive-XXXXXX").string();
        path_ = mkdtemp(name.data());
    }
    ~TemporaryFolder() { std::filesystem::remove_all(path_); }
    TemporaryFolder(const TemporaryFolder&) = delete;
    TemporaryFolder& operator=(const TemporaryFolder&) = delete;

    [[nodiscard]] std::string file(const std::string& name) const {
        return (path_ / name).string();
    }
    std::string write(const std::string& name, const std::string& text) const {
        std::ofstream(path_ / name) << "#usda 1.0\n" << text;
        return file(name);
    }
    void remove() const { std::filesystem::remove_all(path_); }

private:
    std::filesystem::path path_;
};

std::string nested(const std::string& open, const std::string& close, int depth) {
    std::string text;
    for (int i = 0; i < depth; ++i) text += open;
    for (int i = 0; i < depth; ++i) text += close;
    return text;
}

}  // namespace

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
             Case{"def \"A\" (\n payload = </B>\n) {\n}\ndef \"B\" (\n inherits = </A>\n) {\n}\n",
                  "ArcCycle", "/A"},
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

TEST(StageBadInput, ASublayerThatContainsItselfIsACycle) {
    const TemporaryFolder folder;
    folder.write("a.usda", "(\n subLayers = [@./b.usda@]\n)\ndef \"A\" {\n}\n");
    folder.write("b.usda", "(\n subLayers = [@./a.usda@]\n)\ndef \"B\" {\n}\n");
    auto opened = Stage::open(folder.file("a.usda"));
    ASSERT_TRUE(opened);
    auto& stage = **opened;
    EXPECT_TRUE(stage.prim(SdfPath("/A")) && stage.prim(SdfPath("/B")));
    const auto errors = stage.errors();
    ASSERT_EQ(errors.size(), 1u);
    EXPECT_EQ(errors.front().type, "SublayerCycle");
    EXPECT_THAT(errors.front().message, HasSubstr("a.usda"));
    expectUsable(stage, SdfLayerRefPtr(stage.rootLayer()));
}

TEST(StageBadInput, AnArcToADeepPathLeavesOutItsPrimAndThoseThatUseIt) {
    for (const int depth : kDepths)
        for (const char* kind : {"reference", "payload", "inherit", "specialize"}) {
            SCOPED_TRACE(std::string(kind) + " of " + std::to_string(depth));
            const auto layer = badLayer(
                "def \"A\" {\n def \"Part\" {\n}\n}\ndef \"B\" (\n inherits = </A>\n) {\n}\n"
                "def \"C\" {\n}\n");
            const auto part = layer->GetPrimAtPath(SdfPath("/A/Part"));
            const auto add = [&] {
                const auto deep = pathOfDepth(depth);
                if (*kind == 'r') part->GetReferenceList().Prepend({"", deep});
                if (*kind == 'p') part->GetPayloadList().Prepend({"", deep});
                if (*kind == 'i') part->GetInheritPathList().Prepend(deep);
                if (*kind == 's') part->GetSpecializesList().Prepend(deep);
            };
            const auto expectLeftOut = [&](Stage& stage) {
                EXPECT_FALSE(stage.prim(SdfPath("/A")));
                EXPECT_FALSE(stage.prim(SdfPath("/B")));
                EXPECT_TRUE(stage.prim(SdfPath("/C")));
                EXPECT_THAT(
                    stage.errors(),
                    ElementsAre(AllOf(Field(&CompositionError::type, "ArcTooDeep"),
                                      Field(&CompositionError::prim, SdfPath("/A")),
                                      Field(&CompositionError::message,
                                            AllOf(HasSubstr(layer->GetIdentifier()),
                                                  HasSubstr("</A/Part>"), HasSubstr("</d/d/d/d"),
                                                  HasSubstr(std::to_string(depth) + " elements"),
                                                  HasSubstr("at most 512")))),
                                Field(&CompositionError::prim, SdfPath("/B"))));
                expectUsable(stage, layer);
            };
            Stage followed(layer);
            ASSERT_TRUE(followed.prim(SdfPath("/B/Part")));
            add();
            expectLeftOut(followed);
            Stage opened(layer);
            expectLeftOut(opened);

            part->ClearInfo(TfToken(*kind == 'r'   ? pxr::SdfFieldKeys->References
                                    : *kind == 'p' ? pxr::SdfFieldKeys->Payload
                                    : *kind == 'i' ? pxr::SdfFieldKeys->InheritPaths
                                                   : pxr::SdfFieldKeys->Specializes));
            for (const auto* stage : {&followed, &opened}) {
                EXPECT_TRUE(stage->prim(SdfPath("/B/Part"))) << "it is mended";
                EXPECT_THAT(stage->errors(), IsEmpty());
            }
        }
}

TEST(StageBadInput, ALayerBehindAnArcThatLeadsTooDeepIsLeftOut) {
    const TemporaryFolder folder;
    const std::string deep = pathOfDepth(40'000).GetString();
    folder.write("sub.usda", "def \"S\" (\n references = @./asset.usda@</M>\n) {\n}\n");
    folder.write("asset.usda", "def \"M\" (\n references = @./bad.usda@</X>\n) {\n}\n");
    folder.write("bad.usda", "def \"X\" (\n references = <" + deep + ">\n) {\n}\n");
    folder.write("root.usda", "(\n subLayers = [@./sub.usda@]\n)\ndef \"A\" {\n}\n");
    auto opened = Stage::open(folder.file("root.usda"));
    ASSERT_TRUE(opened);
    auto& stage = **opened;
    EXPECT_TRUE(stage.prim(SdfPath("/A")) && stage.prim(SdfPath("/S")));
    const auto errors = stage.errors();
    ASSERT_FALSE(errors.empty());
    EXPECT_EQ(errors.front().type, "ArcTooDeep");
    EXPECT_THAT(errors.front().message,
                AllOf(HasSubstr("bad.usda"), HasSubstr("</X>"), HasSubstr("40000 elements")));
    expectUsable(stage, SdfLayerRefPtr(stage.rootLayer()));
}

TEST(StageBadInput, ATextThatIsNestedTooDeeplyIsNotRead) {
    const TemporaryFolder folder;
    const std::string texts[] = {
        nested("def \"d\" {\n", "}\n", 200'000),
        "def \"A\" (\n customData = {\n" + nested("dictionary d = {\n", "}\n", 200'000) +
            "}\n) {\n}\n",
        "def \"A\" {\n int[] x = " + nested("[", "]", 200'000) + "\n}\n",
        "def \"A\" {\n pathExpression x = \"" + nested("(", ")", 200'000) + "\"\n}\n",
        "/* \"\"\" @ < */\n// ' @ <\n" + nested("def \"d\" {\n", "}\n", 200'000),
        "def \"A\" {\n asset x = @@@a\\@@@b@@@\n" + nested("def \"d\" {\n", "}\n", 200'000) +
            "}\n"};
    for (const auto& text : texts) {
        SCOPED_TRACE(text.substr(0, 40));
        const auto bad = folder.write("bad.usda", text);
        const auto refused = Stage::open(bad);
        ASSERT_FALSE(refused);
        EXPECT_EQ(refused.error().code, ErrorCode::LayerUnreadable);
        EXPECT_THAT(refused.error().message,
                    AllOf(HasSubstr(bad), HasSubstr("line "), HasSubstr("4096")));
        for (const char* arc : {"(\n subLayers = [@./bad.usda@]\n)\ndef \"A\" {\n}\n",
                                "def \"A\" (\n references = @./bad.usda@</d>\n) {\n}\n"}) {
            auto opened = Stage::open(folder.write("root.usda", arc));
            ASSERT_TRUE(opened);
            EXPECT_TRUE((*opened)->prim(SdfPath("/A")));
            const auto errors = (*opened)->errors();
            EXPECT_TRUE(std::ranges::any_of(errors, [&](const auto& error) {
                return error.type == "TextTooDeep" && error.message.find(bad) != std::string::npos;
            }));
            expectUsable(**opened, SdfLayerRefPtr((*opened)->rootLayer()));
        }
    }
}

TEST(StageBadInput, PayloadsAreCheckedWhenTheyAreLoaded) {
    const TemporaryFolder folder;
    const auto bad = folder.write("bad.usda", nested("def \"d\" {\n", "}\n", 200'000));
    const auto other = folder.write("other.usda", "def \"M\" {\n}\n");
    const auto root =
        folder.write("root.usda",
                     "def \"A\" (\n payload = @./bad.usda@</d>\n) {\n}\ndef \"B\" (\n payload = "
                     "@./other.usda@</M>\n) {\n}\n");
    auto opened = Stage::open(root, {.load = LoadRules::none()});
    ASSERT_TRUE(opened);
    auto& stage = **opened;
    EXPECT_THAT(stage.errors(), IsEmpty());
    stage.load(SdfPath("/A"));
    const auto errors = stage.errors();
    EXPECT_TRUE(std::ranges::any_of(errors, [&](const auto& error) {
        return error.type == "TextTooDeep" && error.message.find(bad) != std::string::npos;
    }));
    EXPECT_FALSE(SdfLayer::Find(other)) << "its payload is not loaded";
    expectUsable(stage, SdfLayerRefPtr(stage.rootLayer()));
}

TEST(StageBadInput, BracketsInStringsCommentsAndAssetPathsDoNotNest) {
    const TemporaryFolder folder;
    const std::string brackets(5'000, '{');
    auto opened = Stage::open(
        folder.write("root.usda", "# " + brackets + "\ndef \"A\" (\n doc = \"\"\"" + brackets +
                                      "\" \\\"\n\"\"\"\n) {\n string s = '" + brackets +
                                      "\"'\n asset a = @" + brackets + "@\n}\n"));
    ASSERT_TRUE(opened);
    EXPECT_TRUE((*opened)->property(SdfPath("/A.a")));
}

TEST(StageBadInput, DeepPathsHaveNoPrims) {
    for (const int depth : kDepths) {
        SCOPED_TRACE(depth);
        const auto layer = badLayer("def \"A\" {\n rel r\n}\n");
        Stage stage(layer);
        const SdfPath deep = pathOfDepth(depth);
        layer->GetRelationshipAtPath(SdfPath("/A.r"))->GetTargetPathList().Prepend(deep);
        EXPECT_FALSE(stage.prim(deep));
        EXPECT_FALSE(stage.property(deep.AppendProperty(TfToken("x"))));
        EXPECT_THAT(stage.property(SdfPath("/A.r")).targets(), IsEmpty());
        EXPECT_TRUE(stage.property(SdfPath("/A.r")).hasAuthoredTargets());
        layer->GetRelationshipAtPath(SdfPath("/A.r"))->GetTargetPathList().Remove(deep);
        EXPECT_THAT(stage.property(SdfPath("/A.r")).targets(), IsEmpty());
        stage.unload(deep);
        EXPECT_EQ(stage.loadRules(), LoadRules::all());
        stage.setMask(PopulationMask({deep, SdfPath("/A")}));
        EXPECT_TRUE(stage.prim(SdfPath("/A")));
        stage.setMask({});
        expectUsable(stage, layer);
    }
}

TEST(StageBadInput, TextThatIsNotUtf8IsAValueLikeAnyOther) {
    const auto layer = badLayer("def \"A\" {\n string s\n}\n");
    Stage stage(layer);
    const std::string text("\xff\xfe\xc3(");
    layer->GetAttributeAtPath(SdfPath("/A.s"))->SetDefaultValue(pxr::VtValue(text));
    EXPECT_EQ(stage.property(SdfPath("/A.s")).value(), pxr::VtValue(text));
    {
        pxr::TfErrorMark mark;
        layer->GetPrimAtPath(SdfPath("/A"))
            ->GetReferenceList()
            .Prepend({text + ".usda", SdfPath()});
        mark.Clear();
    }
    EXPECT_FALSE(stage.errors().empty());
    expectUsable(stage, layer);
}

TEST(StageBadInput, PathsThatAreNoneHaveNoPrims) {
    const auto layer = badLayer("def \"A\" {\n}\n");
    Stage stage(layer);
    for (const SdfPath& path :
         {SdfPath(), SdfPath("A"), SdfPath("/A{v=x}"), SdfPath("/A.x"), SdfPath("..")}) {
        SCOPED_TRACE(path.GetString());
        EXPECT_FALSE(stage.prim(path));
        EXPECT_FALSE(stage.property(path));
        stage.unload(path);
        stage.setMask(PopulationMask({path, SdfPath("/A")}));
        stage.setMask({});
    }
    EXPECT_EQ(stage.loadRules(), LoadRules::all());
    EXPECT_FALSE(stage.prim(SdfPath("/A")).child(TfToken("1 bad")));
    EXPECT_FALSE(stage.prim(SdfPath("/A")).property(TfToken("")));
    expectUsable(stage, layer);
}

TEST(StageBadInput, LayersThatVanishLeaveTheRestUsable) {
    const TemporaryFolder folder;
    folder.write("sub.usda", "def \"S\" {\n}\n");
    folder.write("asset.usda", "def \"M\" {\n def \"Part\" {\n}\n}\n");
    folder.write("root.usda",
                 "(\n subLayers = [@./sub.usda@]\n)\ndef \"A\" (\n references = "
                 "@./asset.usda@</M>\n) {\n}\n");
    auto opened = Stage::open(folder.file("root.usda"));
    ASSERT_TRUE(opened);
    auto& stage = **opened;
    const SdfLayerRefPtr root(stage.rootLayer());
    ASSERT_TRUE(stage.prim(SdfPath("/A/Part")) && stage.prim(SdfPath("/S")));

    folder.remove();
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
    const auto errors = stage.errors();
    ASSERT_FALSE(errors.empty());
    EXPECT_THAT(errors.front().message, AllOf(HasSubstr("asset.usda"), HasSubstr("/M")));
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

}  // namespace usdlive::stage
