#include "usdlive/client/usd/layers/Layers.h"

#include <pxr/usd/sdf/changeBlock.h>

#include "LayersFixture.h"

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

TEST_F(LayersTest, ModesChangeAndAreTold) {
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

TEST(LayersWithoutSession, HaveNoPlaceForTheDelegate) {
    Layers layers(std::make_unique<LayerStackHost>(pxr::SdfLayer::CreateAnonymous("root.usda")));
    EXPECT_FALSE(layers.setEditMode(LayerEditMode::AutoAuthoring));
    EXPECT_EQ(layers.lastError().type, LayerErrorType::InvalidStage);
    EXPECT_EQ(layers.editMode(), LayerEditMode::Normal);
}

}  // namespace usdlive::layers
