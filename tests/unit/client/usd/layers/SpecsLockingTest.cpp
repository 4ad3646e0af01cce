// Tests locks of specs: edits of locked specs are reverted.
#include "usdlive/client/usd/layers/SpecsLocking.h"

#include <pxr/usd/sdf/reference.h>

#include "LayersFixture.h"

namespace usdlive::layers {

using pxr::SdfPath;
using Paths = SpecsLocking::Paths;

class SpecsLockingTest : public LayersFixture {
protected:
    SpecsLockingTest() {
        set(weak, "/A.x", 1);
        set(weak, "/A/B.y", 2);
        frame();
    }
    SpecsLocking& locks() { return layers().specsLocking(); }
};

TEST_F(SpecsLockingTest, ALockedSpecIsRevertedInEveryLayer) {
    EXPECT_EQ(locks().lockSpec(SdfPath("/A"), false), (Paths{SdfPath("/A"), SdfPath("/A.x")}));
    EXPECT_TRUE(locks().isSpecLocked(SdfPath("/A.x")));
    EXPECT_FALSE(locks().isSpecLocked(SdfPath("/A/B")));
    const auto before = weak->GetPrimAtPath(SdfPath("/A"));
    for (const auto& layer : {session, root, strong, weak}) set(layer, "/A.x", 9);
    before->GetReferenceList().Prepend(pxr::SdfReference("a.usda"));
    set(weak, "/A/B.y", 3);
    frame();
    for (const auto& layer : {session, root, strong}) EXPECT_FALSE(has(layer, "/A"));
    EXPECT_EQ(get(weak, "/A.x"), 1);
    EXPECT_FALSE(before->HasReferences());
    EXPECT_EQ(get(weak, "/A/B.y"), 3) << "not locked";
    EXPECT_FALSE(layers().refusedEdits().empty());
    EXPECT_NE(layers().refusedEdits().front().reason.find("ada"), std::string::npos);
    const auto said = layers().refusedEdits().size();
    frame();
    EXPECT_EQ(layers().refusedEdits().size(), said) << "once";
}

TEST_F(SpecsLockingTest, ARemovedPrimIsRestoredWithItsLastContent) {
    locks().lockSpec(SdfPath("/A"), false);
    set(weak, "/A/B.y", 3);
    set(weak, "/A/C.z", 4);
    frame();
    weak->RemoveRootPrim(weak->GetPrimAtPath(SdfPath("/A")));
    frame();
    EXPECT_EQ(get(weak, "/A.x"), 1);
    EXPECT_EQ(get(weak, "/A/B.y"), 3);
    EXPECT_EQ(get(weak, "/A/C.z"), 4);
}

TEST_F(SpecsLockingTest, UnlockedSpecsCanBeEdited) {
    locks().lockSpec(SdfPath("/"), true);
    EXPECT_EQ(locks().allLockedSpecs().size(), 4u);
    EXPECT_EQ(locks().unlockSpec(SdfPath("/A/B"), false).specs,
              (Paths{SdfPath("/A/B"), SdfPath("/A/B.y")}));
    set(weak, "/A/B.y", 5);
    set(weak, "/A.x", 5);
    frame();
    EXPECT_EQ(get(weak, "/A/B.y"), 5);
    EXPECT_EQ(get(weak, "/A.x"), 1);
    locks().unlockAllSpecs();
    set(weak, "/A.x", 6);
    frame();
    EXPECT_EQ(get(weak, "/A.x"), 6);
    EXPECT_EQ(refusal(locks().lockSpec(SdfPath("/Nothing"), false)), LayerErrorType::InvalidParam);
    const auto unlocked = locks().unlockSpec(SdfPath("relative"), false);
    EXPECT_TRUE(unlocked.specs.empty());
    ASSERT_TRUE(unlocked.refused);
    EXPECT_EQ(unlocked.refused->type, LayerErrorType::InvalidParam);
}

TEST_F(SpecsLockingTest, EditsBeforeALockStay) {
    set(weak, "/A.x", 7);
    locks().lockSpec(SdfPath("/A.x"), false);
    frame();
    EXPECT_EQ(get(weak, "/A.x"), 7);
}

TEST_F(SpecsLockingTest, LocksAreFoundAgainAndFollowTheRootLayer) {
    locks().lockSpec(SdfPath("/A.x"), false);
    const auto events = frameEvents();
    ASSERT_TRUE(find(events, LayerEventType::SpecsLockingChanged));
    EXPECT_EQ(find(events, LayerEventType::SpecsLockingChanged)->paths, Paths{SdfPath("/A.x")});
    closeStage();
    EXPECT_TRUE(locks().isSpecLocked(SdfPath("/A.x")));
    set(weak, "/A.x", 9);
    frame();
    EXPECT_EQ(get(weak, "/A.x"), 1);
    root->SetCustomLayerData({});
    set(weak, "/A.x", 9);  // somebody else unlocked it and edits it at once
    frame();
    EXPECT_EQ(get(weak, "/A.x"), 9);
    EXPECT_FALSE(locks().isSpecLocked(SdfPath("/A.x")));
}

TEST_F(SpecsLockingTest, TheDelegatesEditsOfALockedSpecAreRevertedToo) {
    ASSERT_TRUE(layers().setEditMode(LayerEditMode::AutoAuthoring));
    locks().lockSpec(SdfPath("/A"), false);
    set(target(), "/A.x", 9);
    frame();
    EXPECT_EQ(get(weak, "/A.x"), 1);
    EXPECT_FALSE(has(target(), "/A.x"));
    EXPECT_EQ(layers().refusedEdits().back().path, SdfPath("/A.x"));
}

TEST_F(SpecsLockingTest, ALockedPrimTakesNothingNew) {
    locks().lockSpec(SdfPath("/A"), false);
    set(strong, "/A.new", 1);
    set(root, "/A.x", 9);
    frame();
    EXPECT_FALSE(has(strong, "/A"));
    EXPECT_FALSE(has(root, "/A"));
    EXPECT_TRUE(std::ranges::any_of(layers().refusedEdits(), [](const RefusedEdit& edit) {
        return edit.path == SdfPath("/A.new") && edit.reason == "/A is locked by ada";
    }));
}

TEST_F(SpecsLockingTest, ManyAdditionsAreRevertedInOneFrame) {
    for (int i = 0; i < 2000; ++i) define(weak, "/A/Old" + std::to_string(i));
    locks().lockSpec(SdfPath("/A"), true);
    for (int i = 0; i < 2000; ++i) define(strong, "/A/New" + std::to_string(i) + "/Below");
    frame();
    EXPECT_FALSE(has(strong, "/A/New0"));
    EXPECT_FALSE(has(strong, "/A/New1999"));
    EXPECT_TRUE(has(weak, "/A/Old1999"));
}

TEST_F(SpecsLockingTest, ARenameOfALockedPrimIsRevertedWithItsEdits) {
    locks().lockSpec(SdfPath("/A"), true);
    pxr::SdfBatchNamespaceEdit edits;
    edits.Add(SdfPath("/A"), SdfPath("/Z"));
    ASSERT_TRUE(weak->Apply(edits));
    set(weak, "/Z.x", 9);
    frame();
    EXPECT_FALSE(has(weak, "/Z"));
    EXPECT_EQ(get(weak, "/A.x"), 1);
}

}  // namespace usdlive::layers
