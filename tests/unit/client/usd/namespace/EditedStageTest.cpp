// Tests namespace edits of composed stages of this library.
#include "usdlive/client/usd/namespace/EditedStage.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/schema.h>

#include <memory>
#include <string>

#include "usdlive/client/usd/namespace/NamespaceEditor.h"
#include "usdlive/client/usd/stage/Stage.h"

namespace usdlive {
namespace {

using pxr::SdfLayer;
using pxr::SdfLayerRefPtr;
using pxr::SdfPath;
using testing::ElementsAre;

SdfLayerRefPtr layerFor(const std::string& text) {
    auto layer = SdfLayer::CreateAnonymous(".usda");
    EXPECT_TRUE(layer->ImportFromString("#usda 1.0\n" + text));
    return layer;
}

std::string whyNot(NamespaceEditor& editor) {
    auto why = editor.CanApplyEdits().whyNot();
    editor.ClearEdits();
    return why;
}

TEST(EditedStage, AStageShowsAtOnceWhatABatchHasMoved) {
    stage::Stage stage(
        layerFor("def \"A\" {\n    def \"X\" {\n    }\n}\ndef \"B\" {\n    rel r = "
                 "</A/X>\n}\n"));
    NamespaceEditor editor(stage);
    editor.MovePrimAtPath(SdfPath("/A/X"), SdfPath("/B/Y"));
    editor.RenamePrim(SdfPath("/B"), pxr::TfToken("C"));
    const auto result = editor.ApplyEdits();
    ASSERT_TRUE(result) << result.whyNot();
    EXPECT_TRUE(stage.prim(SdfPath("/C/Y")));
    EXPECT_FALSE(stage.prim(SdfPath("/B")));
    EXPECT_THAT(stage.property(SdfPath("/C.r")).targets(), ElementsAre(SdfPath("/C/Y")));
}

TEST(EditedStage, PrimsOverReferencesAreRelocated) {
    const auto asset = layerFor("def \"M\" {\n    def \"Part\" {\n    }\n}\n");
    stage::Stage stage(
        layerFor("def \"A\" (\n    references = @" + asset->GetIdentifier() + "@</M>\n) {\n}\n"));
    NamespaceEditor editor(stage);
    editor.RenamePrim(SdfPath("/A/Part"), pxr::TfToken("Piece"));
    ASSERT_TRUE(editor.ApplyEdits());
    EXPECT_TRUE(stage.prim(SdfPath("/A/Piece")));
    EXPECT_FALSE(stage.prim(SdfPath("/A/Part")));
    EXPECT_TRUE(asset->HasSpec(SdfPath("/M/Part")));
}

TEST(EditedStage, ABatchSeesTheRelocatesOfTheStage) {
    const auto asset = layerFor("def \"M\" {\n    def \"Part\" {\n    }\n}\n");
    stage::Stage stage(
        layerFor("(\n    relocates = {\n        </A/Part>: </A/Piece>\n    }\n)\ndef \"A\" (\n"
                 "    references = @" +
                 asset->GetIdentifier() + "@</M>\n) {\n}\n"));
    ASSERT_TRUE(stage.prim(SdfPath("/A/Piece")));
    NamespaceEditor editor(stage);
    editor.RenamePrim(SdfPath("/A/Piece"), pxr::TfToken("Bit"));
    editor.RenamePrim(SdfPath("/A/Bit"), pxr::TfToken("Chip"));
    const auto result = editor.ApplyEdits();
    ASSERT_TRUE(result) << result.whyNot();
    EXPECT_TRUE(stage.prim(SdfPath("/A/Chip")));
}

TEST(EditedStage, StagesThatDependOnItAreCorrected) {
    const auto asset = layerFor("def \"M\" {\n    def \"Part\" {\n    }\n}\n");
    const auto user = layerFor("def \"A\" (\n    references = @" + asset->GetIdentifier() +
                               "@</M>\n) {\n    over \"Part\" {\n        int n = 1\n    }\n}\n");
    stage::Stage edited(asset), dependent(user);
    NamespaceEditor editor(edited);
    const auto number = editor.AddDependentStage(dependent);
    editor.RenamePrim(SdfPath("/M/Part"), pxr::TfToken("Piece"));
    ASSERT_TRUE(editor.ApplyEdits());
    EXPECT_TRUE(dependent.property(SdfPath("/A/Piece.n")));
    EXPECT_FALSE(user->HasSpec(SdfPath("/A/Part")));
    editor.RemoveDependentStage(number);
    const auto before = user->GetField(SdfPath("/A"), pxr::SdfFieldKeys->References);
    editor.RenamePrim(SdfPath("/M"), pxr::TfToken("N"));
    ASSERT_TRUE(editor.ApplyEdits());
    EXPECT_EQ(user->GetField(SdfPath("/A"), pxr::SdfFieldKeys->References), before);
}

TEST(EditedStage, WhatTheStageLeavesOutIsNotEdited) {
    const auto model = layerFor("def \"M\" {\n    def \"Part\" {\n    }\n}\n");
    const auto root = layerFor("def \"A\" (\n    payload = @" + model->GetIdentifier() +
                               "@</M>\n) {\n}\ndef \"B\" {\n}\n");
    const char* const kNone = "The prim to edit is not a valid prim";
    stage::Stage unloaded(root, {}, {.load = stage::LoadRules::none()});
    NamespaceEditor editor(unloaded);
    editor.RenamePrim(SdfPath("/A/Part"), pxr::TfToken("Piece"));
    EXPECT_EQ(whyNot(editor), kNone);
    unloaded.load(SdfPath("/A"));
    editor.RenamePrim(SdfPath("/A/Part"), pxr::TfToken("Piece"));
    EXPECT_EQ(whyNot(editor), "");

    stage::Stage masked(root, {}, {.mask = stage::PopulationMask({SdfPath("/A")})});
    NamespaceEditor ofMasked(masked);
    ofMasked.RenamePrim(SdfPath("/B"), pxr::TfToken("C"));
    EXPECT_EQ(whyNot(ofMasked), kNone);
    masked.setMask(stage::PopulationMask(pxr::SdfPathVector()));
    ofMasked.RenamePrim(SdfPath("/A"), pxr::TfToken("C"));
    EXPECT_EQ(whyNot(ofMasked), kNone);
    masked.setMask({});
    ofMasked.RenamePrim(SdfPath("/B"), pxr::TfToken("C"));
    EXPECT_EQ(whyNot(ofMasked), "");
}

TEST(EditedStage, PrototypesAndTheirProxiesAreRefused) {
    stage::Stage stage(
        layerFor("class \"M\" {\n    def \"Part\" {\n    }\n}\ndef \"A\" (\n    "
                 "instanceable = true\n    references = </M>\n) {\n}\n"));
    NamespaceEditor editor(stage);
    editor.DeletePrimAtPath(stage.prototypes().front().path().AppendChild(pxr::TfToken("Part")));
    EXPECT_EQ(whyNot(editor), "The prim to edit belongs to a prototype prim");
    editor.DeletePrimAtPath(SdfPath("/A/Part"));
    EXPECT_EQ(whyNot(editor),
              "The prim to edit is a prototype proxy descendant of an instance prim");
}

TEST(EditedStage, AStageThatIsClosedIsSaidToBe) {
    auto stage = std::make_unique<stage::Stage>(layerFor("def \"A\" {\n}\n"));
    NamespaceEditor editor(*stage);
    editor.RenamePrim(SdfPath("/A"), pxr::TfToken("B"));
    EXPECT_TRUE(editor.CanApplyEdits());
    stage.reset();
    EXPECT_EQ(whyNot(editor), "The stage to edit is no longer open");
}

TEST(EditedStage, APrimThatBecomesActiveCanBeEditedByTheSameEditor) {
    const auto root = layerFor("def \"A\" (\n    active = false\n) {\n    def \"X\" {\n    }\n}\n");
    stage::Stage stage(root);
    NamespaceEditor editor(stage);
    editor.RenamePrim(SdfPath("/A/X"), pxr::TfToken("Y"));
    EXPECT_EQ(whyNot(editor), "The prim to edit is not a valid prim");
    root->SetField(SdfPath("/A"), pxr::SdfFieldKeys->Active, true);
    editor.RenamePrim(SdfPath("/A/X"), pxr::TfToken("Y"));
    EXPECT_TRUE(editor.ApplyEdits());
    EXPECT_TRUE(stage.prim(SdfPath("/A/Y")));
}

}  // namespace
}  // namespace usdlive
