// Tests Layers: edit modes, events and threads.
#include "usdlive/client/usd/layers/Layers.h"

#include <pxr/usd/sdf/changeBlock.h>
#include <pxr/usd/sdf/variantSetSpec.h>
#include <pxr/usd/sdf/variantSpec.h>

#include <functional>
#include <map>
#include <thread>

#include "LayersFixture.h"
#include "usd/stage/Composition.h"
#include "usdlive/client/usd/Misuse.h"
#include "usdlive/client/usd/layers/ComposedStageHost.h"
#include "usdlive/client/usd/stage/Stage.h"

namespace usdlive::layers {

class LayersTest : public LayersFixture {};

TEST_F(LayersTest, EventsComeOncePerFrameInOrder) {
    (void)frameEvents();
    set(weak, "/A.x", 1);
    set(weak, "/A.x", 2);
    root->SetStartTimeCode(5);
    root->SetSubLayerOffset(pxr::SdfLayerOffset(3), 0);
    host().setEditTarget(weak);
    const auto events = frameEvents();
    std::vector<LayerEventType> types;
    for (const auto& event : events) types.push_back(event.type);
    EXPECT_EQ(types, (std::vector{LayerEventType::PrimSpecsChanged, LayerEventType::InfoChanged,
                                  LayerEventType::EditTargetChanged}));
    EXPECT_EQ(events[0].layer, weak->GetIdentifier());
    EXPECT_EQ(events[0].paths, (std::vector{pxr::SdfPath("/A"), pxr::SdfPath("/A.x")}));
    EXPECT_EQ(events[1].values,
              (std::vector<std::string>{"startTimeCode", "subLayerOffsets_offset"}));
    EXPECT_TRUE(frameEvents().empty());
}

TEST_F(LayersTest, OtherSublayersAreOtherUsedLayers) {
    (void)frameEvents();
    root->RemoveSubLayerPath(0);
    const auto events = frameEvents();
    EXPECT_TRUE(find(events, LayerEventType::SublayersChanged));
    EXPECT_TRUE(find(events, LayerEventType::UsedLayersChanged));
    const auto stranger = pxr::SdfLayer::CreateAnonymous("stranger.usda");
    define(stranger, "/A");
    EXPECT_TRUE(frameEvents().empty()) << "of no layer of this stage";
}

TEST_F(LayersTest, ChangesOfTheModeAreNotified) {
    EXPECT_EQ(layers().editMode(), LayerEditMode::Normal);
    (void)frameEvents();
    EXPECT_TRUE(layers().setEditMode(LayerEditMode::SpecsLinking));
    const auto events = frameEvents();
    EXPECT_TRUE(find(events, LayerEventType::EditModeChanged));
    EXPECT_TRUE(find(events, LayerEventType::EditTargetChanged));
    EXPECT_FALSE(find(events, LayerEventType::SublayersChanged)) << "the delegate is not shown";
    EXPECT_TRUE(layers().setEditMode(LayerEditMode::AutoAuthoring));
    EXPECT_TRUE(layers().setEditMode(LayerEditMode::Normal));
}

// There is only the stage's composition, and an edit of a value invalidates nothing in it.
TEST_F(LayersTest, AValueThatIsDistributedComposesNothingAgain) {
    set(weak, "/A.x", 1);
    set(strong, "/A/B.y", 1);
    set(strong, "/Far.z", 1);
    const auto prim = weak->GetPrimAtPath(pxr::SdfPath("/A"));
    const auto variants = pxr::SdfVariantSetSpec::New(prim, "look");
    (void)pxr::SdfVariantSpec::New(variants, "red");
    prim->GetVariantSetNameList().Prepend("look");
    prim->SetVariantSelection("look", "red");
    ASSERT_TRUE(layers().setEditMode(LayerEditMode::AutoAuthoring));
    set(target(), "/A.x", 2);
    frame();
    const auto composed = [&] {
        (void)host().usedLayers();
        return host().composition()->primsComposed();
    };
    const auto before = composed();
    EXPECT_GE(before, 4u);
    for (int i = 3; i < 10; ++i) {
        set(target(), "/A.x", i);
        (void)layers().state().localLayerIdentifiers(true, true, true);
        frame();
        EXPECT_EQ(get(weak, "/A.x"), i);
        (void)layers().specsLocking().isSpecLocked(pxr::SdfPath("/A"));
        (void)layers().specsLinking().specLinks(pxr::SdfPath("/A"), true);
    }
    EXPECT_EQ(composed(), before);
    weak->GetPrimAtPath(pxr::SdfPath("/A"))->SetVariantSelection("look", "");
    EXPECT_GT(composed(), before);
}

TEST_F(LayersTest, AnotherThreadGetsAClearErrorAndChangesNothing) {
    set(weak, "/A.x", 1);
    ASSERT_TRUE(layers().setEditMode(LayerEditMode::AutoAuthoring));
    frame();
    (void)layers().takeEvents();
    set(target(), "/A.x", 2);
    auto& all = layers();
    const std::map<std::string, std::function<void()>> calls{
        {"state", [&] { (void)all.state(); }},
        {"autoAuthoring", [&] { (void)all.autoAuthoring(); }},
        {"specsLinking", [&] { (void)all.specsLinking(); }},
        {"specsLocking", [&] { (void)all.specsLocking(); }},
        {"host", [&] { (void)all.host(); }},
        {"editMode", [&] { (void)all.editMode(); }},
        {"setEditMode", [&] { (void)all.setEditMode(LayerEditMode::Normal); }},
        {"update", [&] { (void)all.update(1e9); }},
        {"distribute", [&] { (void)all.distribute(); }},
        {"takeEvents", [&] { (void)all.takeEvents(); }},
        {"refuse", [&] { all.refuse({{pxr::SdfPath("/A"), "", "", {}, ""}}); }},
        {"refusedEdits", [&] { (void)all.refusedEdits(); }},
        {"setLive", [&] { all.setLive(nullptr); }},
    };
    for (const auto& [name, call] : calls) {
        std::optional<Error> error;
        std::thread([&error, &call = call] {
            try {
                call();
            } catch (const Misuse& misuse) {
                error = misuse.error;
            }
        }).join();
        ASSERT_TRUE(error) << name;
        EXPECT_EQ(error->code, ErrorCode::InvalidArgument) << name;
        EXPECT_NE(error->message.find("Layers::" + name + "() was called on another thread"),
                  std::string::npos)
            << error->message;
    }
    EXPECT_EQ(get(weak, "/A.x"), 1) << "nothing was distributed";
    EXPECT_EQ(all.editMode(), LayerEditMode::AutoAuthoring);
    EXPECT_TRUE(all.refusedEdits().empty());
    frame();
    EXPECT_EQ(get(weak, "/A.x"), 2) << "this thread continues";
}

TEST_F(LayersTest, AStageSharesItsMutesAndEditTargetWithItsLayers) {
    set(weak, "/A.x", 1);
    set(strong, "/A.y", 1);
    stage::Stage stage(root, session);
    Layers all(std::make_unique<ComposedStageHost>(stage), {.user = {"ada"}});
    StageHost& shared = all.host();
    EXPECT_EQ(shared.usedLayers().size(), 4U);
    EXPECT_EQ(shared.childNames(pxr::SdfPath("/")), pxr::TfTokenVector{pxr::TfToken("A")});
    EXPECT_EQ(shared.propertyNames(pxr::SdfPath("/A")).size(), 2U);

    shared.muteAndUnmute({strong->GetIdentifier(), root->GetIdentifier()}, {});
    EXPECT_EQ(stage.mutedLayers(), std::vector{strong->GetIdentifier()}) << "a root stays";
    EXPECT_EQ(shared.propertyNames(pxr::SdfPath("/A")).size(), 1U);
    stage.setMutedLayers({});
    EXPECT_FALSE(all.state().isLayerMuted(strong->GetIdentifier()));

    EXPECT_TRUE(shared.setEditTarget(weak));
    EXPECT_EQ(stage.editTarget().layer(), pxr::SdfLayerHandle(weak));
    EXPECT_FALSE(shared.setEditTarget(pxr::SdfLayer::CreateAnonymous()));
    ASSERT_TRUE(all.setEditMode(LayerEditMode::AutoAuthoring));
    all.update(0);
    set(shared.editTarget(), "/A.x", 2);
    all.update(1);
    EXPECT_EQ(get(weak, "/A.x"), 2);
    EXPECT_EQ(stage.property(pxr::SdfPath("/A.x")).value(), pxr::VtValue(2.0));
}

TEST(LayersWithoutSession, HaveNoPlaceForTheDelegate) {
    Layers layers(std::make_unique<LayerStackHost>(pxr::SdfLayer::CreateAnonymous("root.usda")));
    const auto set = layers.setEditMode(LayerEditMode::AutoAuthoring);
    ASSERT_FALSE(set);
    EXPECT_EQ(set.error().type, LayerErrorType::InvalidStage);
    EXPECT_EQ(layers.editMode(), LayerEditMode::Normal);
}

}  // namespace usdlive::layers
