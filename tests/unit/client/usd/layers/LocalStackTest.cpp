#include "usdlive/client/usd/layers/LocalStack.h"

#include "LayersFixture.h"

namespace usdlive::layers {

class LocalStackTest : public LayersFixture {};

TEST_F(LocalStackTest, HasLayersStrongToWeakWithTheirWholeOffsets) {
    root->SetTimeCodesPerSecond(48);
    const auto below = pxr::SdfLayer::CreateAnonymous("below.usda");
    weak->InsertSubLayerPath(below->GetIdentifier());
    weak->SetTimeCodesPerSecond(48);
    below->SetTimeCodesPerSecond(24);
    root->SetSubLayerOffset(pxr::SdfLayerOffset(10), 1);
    LocalStack stack(host());
    ASSERT_EQ(stack.layers().size(), 5u);
    EXPECT_TRUE(stack.layers().front().ofSession);
    EXPECT_FALSE(stack.layers()[1].ofSession);
    EXPECT_EQ(stack.timeCodesPerSecond(), 48);
    EXPECT_EQ(stack.find(weak)->toStack * 1.0, 11);
    EXPECT_EQ(stack.find(below)->toStack * 1.0, 12) << "twice the rate";
    host().muteAndUnmute({weak->GetIdentifier()}, {});
    stack.invalidate();
    EXPECT_FALSE(stack.find(weak));
    EXPECT_FALSE(stack.find(below));
}

TEST_F(LocalStackTest, ComposesNames) {
    set(strong, "/A.x", 1);
    set(weak, "/A/B.y", 1);
    EXPECT_EQ(host().childNames(pxr::SdfPath("/A")), std::vector{pxr::TfToken("B")});
    EXPECT_EQ(host().propertyNames(pxr::SdfPath("/A")), std::vector{pxr::TfToken("x")});
    EXPECT_TRUE(host().propertyNames(pxr::SdfPath("/Nothing")).empty());
    EXPECT_FALSE(host().setEditTarget(pxr::SdfLayer::CreateAnonymous("stranger.usda")));
}

}  // namespace usdlive::layers
