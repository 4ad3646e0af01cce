// Tests LocalStack: the order of layers, their offsets and composed names.
#include "usd/layers/LocalStack.h"

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
    EXPECT_FALSE(stack.find(weak));
    EXPECT_FALSE(stack.find(below));
    host().muteAndUnmute({}, {weak->GetIdentifier()});
    EXPECT_TRUE(stack.find(below));
    pxr::SdfLayer::AddToMutedLayers(weak->GetIdentifier());
    EXPECT_TRUE(stack.find(weak));
    EXPECT_FALSE(stack.find(below)) << "a layer that is muted for all stages is empty";
    pxr::SdfLayer::RemoveFromMutedLayers(weak->GetIdentifier());
    EXPECT_TRUE(stack.find(below));
}

// A stage like one in Python, which composes elsewhere.
class ForeignHost final : public StageHost {
public:
    explicit ForeignHost(StageHost& host) : host_(host) {}
    [[nodiscard]] pxr::SdfLayerHandle rootLayer() const override { return host_.rootLayer(); }
    [[nodiscard]] pxr::SdfLayerHandle sessionLayer() const override { return host_.sessionLayer(); }
    [[nodiscard]] std::vector<std::string> mutedLayers() const override {
        return host_.mutedLayers();
    }
    void muteAndUnmute(const std::vector<std::string>& mute,
                       const std::vector<std::string>& unmute) override {
        host_.muteAndUnmute(mute, unmute);
    }
    [[nodiscard]] pxr::SdfLayerHandle editTarget() const override { return host_.editTarget(); }
    bool setEditTarget(const pxr::SdfLayerHandle& layer) override {
        return host_.setEditTarget(layer);
    }
    [[nodiscard]] std::vector<pxr::SdfLayerHandle> usedLayers() const override {
        return host_.usedLayers();
    }
    [[nodiscard]] std::vector<pxr::TfToken> childNames(const pxr::SdfPath& prim) const override {
        return host_.childNames(prim);
    }
    [[nodiscard]] std::vector<pxr::TfToken> propertyNames(const pxr::SdfPath& prim) const override {
        return host_.propertyNames(prim);
    }

private:
    StageHost& host_;
};

TEST_F(LocalStackTest, ComposesItselfForAStageThatComposesElsewhere) {
    const ForeignHost foreign(host());
    LocalStack stack(foreign);
    EXPECT_TRUE(stack.find(weak));
    host().muteAndUnmute({weak->GetIdentifier()}, {});
    stack.mutenessChanged();
    EXPECT_FALSE(stack.find(weak));
    EXPECT_TRUE(stack.find(strong));
    host().muteAndUnmute({}, {weak->GetIdentifier()});
    stack.mutenessChanged();
    EXPECT_TRUE(stack.find(weak));
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
