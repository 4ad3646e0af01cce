// Tests links of specs to layers.
#include "usdlive/client/usd/layers/SpecsLinking.h"

#include "LayersFixture.h"

namespace usdlive::layers {

using pxr::SdfPath;
using Paths = SpecsLinking::Paths;

class SpecsLinkingTest : public LayersFixture {
protected:
    SpecsLinkingTest() {
        set(weak, "/A.x", 1);
        set(weak, "/A/B.y", 2);
    }
    SpecsLinking& links() { return layers().specsLinking(); }
};

TEST_F(SpecsLinkingTest, APrimIsLinkedWithItsPropertiesAndAHierarchyWithEverythingBelow) {
    const auto& layer = strong->GetIdentifier();
    EXPECT_EQ(links().linkSpec(SdfPath("/A"), layer, false),
              (Paths{SdfPath("/A"), SdfPath("/A.x")}));
    EXPECT_EQ(links().linkSpec(SdfPath("/A"), layer, false), Paths()) << "nothing changed";
    EXPECT_EQ(links().linkSpec(SdfPath("/"), layer, false), Paths());
    EXPECT_EQ(links().linkSpec(SdfPath("/"), layer, true),
              (Paths{SdfPath("/A/B"), SdfPath("/A/B.y")}));
    EXPECT_TRUE(links().isSpecLinked(SdfPath("/A/B.y")));
    EXPECT_TRUE(links().isSpecLinkedTo(SdfPath("/A/B.y"), layer));
    EXPECT_FALSE(links().isSpecLinkedTo(SdfPath("/A/B.y"), weak->GetIdentifier()));
    EXPECT_EQ(links().unlinkSpec(SdfPath("/A/B"), layer, false)->size(), 2u);
    EXPECT_EQ(links().linksForLayer(layer)->size(), 2u);
    EXPECT_EQ(links().unlinkSpecsToLayer(layer)->size(), 2u);
    EXPECT_TRUE(links().allLinks().empty());
}

TEST_F(SpecsLinkingTest, MissingSpecsAreNotLinked) {
    for (const char* text : {"", "A", "/Nothing", "/A.nothing", "/A{v=x}"}) {
        const SdfPath path = *text ? SdfPath(text) : SdfPath();
        EXPECT_EQ(refusal(links().linkSpec(path, strong->GetIdentifier(), true)),
                  LayerErrorType::InvalidParam)
            << text;
        EXPECT_EQ(refusal(links().specLinks(path, true)), LayerErrorType::InvalidParam) << text;
    }
    EXPECT_EQ(refusal(links().linkSpec(SdfPath("/A"), "nowhere.usda", false)),
              LayerErrorType::NotFound);
    EXPECT_EQ(refusal(links().linksForLayer("nowhere.usda")), LayerErrorType::NotFound);
    root->SetPermissionToEdit(false);
    EXPECT_EQ(refusal(links().linkSpec(SdfPath("/A"), strong->GetIdentifier(), false)),
              LayerErrorType::ReadOnly);
    EXPECT_FALSE(links().isSpecLinked(SdfPath("/A")));
    root->SetPermissionToEdit(true);
    EXPECT_FALSE(find(frameEvents(), LayerEventType::SpecsLinkingChanged));
}

TEST_F(SpecsLinkingTest, EditsGoToAllLinkedLayersAndAPropertysOwnLinksCount) {
    ASSERT_TRUE(layers().setEditMode(LayerEditMode::SpecsLinking));
    links().linkSpec(SdfPath("/A"), root->GetIdentifier(), false);
    links().linkSpec(SdfPath("/A"), strong->GetIdentifier(), false);
    set(target(), "/A.x", 5);
    set(target(), "/A.added", 6);
    set(target(), "/A/B.y", 7);
    frame();
    EXPECT_EQ(get(root, "/A.x"), 5);
    EXPECT_EQ(get(strong, "/A.x"), 5);
    EXPECT_EQ(get(weak, "/A.x"), 1);
    EXPECT_EQ(get(strong, "/A.added"), 6) << "as its prim";
    EXPECT_EQ(get(weak, "/A/B.y"), 7) << "without a link the strongest opinion decides";
    EXPECT_EQ(links().unlinkSpecFromAllLayers(SdfPath("/A.x"), false), Paths{SdfPath("/A.x")});
    EXPECT_EQ(links().linkSpec(SdfPath("/A.x"), root->GetIdentifier(), false),
              Paths{SdfPath("/A.x")});
    set(target(), "/A.x", 8);
    frame();
    EXPECT_EQ(get(root, "/A.x"), 8);
    EXPECT_EQ(get(strong, "/A.x"), 5);
}

TEST_F(SpecsLinkingTest, LinksAreFoundAgainAndFollowTheRootLayer) {
    links().linkSpec(SdfPath("/A.x"), strong->GetIdentifier(), false);
    const auto events = frameEvents();
    const auto* event = find(events, LayerEventType::SpecsLinkingChanged);
    ASSERT_TRUE(event);
    EXPECT_EQ(event->entries,
              (LayerEvent::Entries{{strong->GetIdentifier(), {std::string("/A.x")}}}));
    closeStage();
    EXPECT_EQ(links().allLinks().at(SdfPath("/A.x")), std::vector{strong->GetIdentifier()});
    (void)frameEvents();
    root->SetCustomLayerData({});  // like an edit of another editor
    EXPECT_FALSE(links().isSpecLinked(SdfPath("/A.x")));
    EXPECT_TRUE(find(frameEvents(), LayerEventType::SpecsLinkingChanged));
}

}  // namespace usdlive::layers
