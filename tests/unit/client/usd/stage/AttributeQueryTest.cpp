// Tests the values of attributes from a weak and a strong layer: order of strength, offsets and
// interpolation.
#include "usdlive/client/usd/stage/AttributeQuery.h"

#include <gtest/gtest.h>
#include <pxr/base/vt/array.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/timeCode.h>

#include <string>

#include "usd/stage/Composition.h"

namespace usdlive::stage {
namespace {

using pxr::SdfPath;
using pxr::TfToken;
using pxr::VtValue;
using Times = std::vector<double>;

// A strong layer above a weak layer that has an offset of 10 and a scale of 2.
class AttributeQueryTest : public testing::Test {
protected:
    void SetUp() override {
        weak_ = read(R"(def "A" {
            double samples.timeSamples = {0: 0, 1: 10, 2: None, 3: 30}
            timecode code = 3
            float[] sizes.timeSamples = {0: [1], 1: [2, 3]}
            string text.timeSamples = {0: "a", 1: "b"}
            double hidden.timeSamples = {0: 1, 1: 2}
            double blocked.timeSamples = {0: 1}
            double blocked = 1
            double still.timeSamples = {0: 1, 1: 2}
            double still = 7
            asset file = @./texture.png@
        })");
        strong_ = read(R"(over "A" {
            double hidden = 5
            double blocked = None
            double still = AnimationBlock
        })");
        strong_->InsertSubLayerPath(weak_->GetIdentifier());
        strong_->SetSubLayerOffset(pxr::SdfLayerOffset(10, 2), 0);
        composition_.emplace(strong_, nullptr, std::vector<std::string>(),
                             Composition::Payloads::All);
        definition_.fallback = VtValue(1.5);
    }

    static pxr::SdfLayerRefPtr read(const std::string& prims) {
        auto layer = pxr::SdfLayer::CreateAnonymous(".usda");
        EXPECT_TRUE(layer->ImportFromString("#usda 1.0\n" + prims));
        return layer;
    }

    [[nodiscard]] AttributeQuery query(const char* attribute,
                                       Interpolation interpolation = Interpolation::Linear) {
        return {*composition_->primIndex(SdfPath("/A")), TfToken(attribute), &definition_,
                interpolation};
    }

    pxr::SdfLayerRefPtr weak_, strong_;
    std::optional<Composition> composition_;
    schema::PropertyDefinition definition_;
};

TEST_F(AttributeQueryTest, SamplesAreInterpolatedInTimesOfTheStage) {
    const auto samples = query("samples");
    EXPECT_EQ(samples.timeSamples(), (Times{10, 12, 14, 16}));
    EXPECT_EQ(samples.get(0), VtValue(0.0));
    EXPECT_EQ(samples.get(11), VtValue(5.0));
    EXPECT_EQ(samples.get(13), VtValue(10.0));
    EXPECT_TRUE(samples.get(15).IsEmpty());
    EXPECT_EQ(samples.get(99), VtValue(30.0));
    EXPECT_EQ(query("samples", Interpolation::Held).get(11), VtValue(0.0));
    EXPECT_EQ(samples.getDefault(), VtValue(1.5)) << "the fallback";
}

TEST_F(AttributeQueryTest, OtherTypesAndArraysOfDifferentSizesAreHeld) {
    EXPECT_EQ(query("text").get(11.9), VtValue(std::string("a")));
    EXPECT_EQ(query("sizes").get(11.9), VtValue(pxr::VtFloatArray{1}));
}

TEST_F(AttributeQueryTest, AStrongerDefaultHidesWeakerSamples) {
    const auto hidden = query("hidden");
    EXPECT_EQ(hidden.source(), ValueSource::Default);
    EXPECT_EQ(hidden.get(11), VtValue(5.0));
    EXPECT_FALSE(hidden.mightBeTimeVarying());
}

TEST_F(AttributeQueryTest, ABlockLeavesTheFallbackAtTimesOnly) {
    const auto blocked = query("blocked");
    EXPECT_TRUE(blocked.isBlocked());
    EXPECT_TRUE(blocked.getDefault().IsEmpty());
    EXPECT_EQ(blocked.get(10), VtValue(1.5));
    EXPECT_EQ(blocked.source(), ValueSource::Fallback);
}

TEST_F(AttributeQueryTest, AnAnimationBlockHidesSamplesAndNoDefault) {
    const auto still = query("still");
    EXPECT_FALSE(still.isBlocked());
    EXPECT_EQ(still.get(10), VtValue(7.0));
    EXPECT_EQ(still.numTimeSamples(), 0U);
}

TEST_F(AttributeQueryTest, TimeCodesAreThoseOfTheStage) {
    EXPECT_EQ(query("code").getDefault(), VtValue(pxr::SdfTimeCode(16)));
}

TEST_F(AttributeQueryTest, WithoutOpinionThereIsTheFallbackOrNothing) {
    EXPECT_EQ(query("nowhere").get(1), VtValue(1.5));
    const AttributeQuery none(*composition_->primIndex(SdfPath("/A")), TfToken("nowhere"), nullptr);
    EXPECT_FALSE(none.hasValue());
    EXPECT_EQ(none.site(), nullptr);
}

TEST_F(AttributeQueryTest, ArraysAreSharedWithTheLayer) {
    const VtValue ofLayer = weak_->GetField(SdfPath("/A.sizes"), TfToken("timeSamples"));
    const auto& sample = ofLayer.UncheckedGet<pxr::SdfTimeSampleMap>().at(0);
    const VtValue found = query("sizes").get(10);
    EXPECT_EQ(found.UncheckedGet<pxr::VtFloatArray>().cdata(),
              sample.UncheckedGet<pxr::VtFloatArray>().cdata());
}

}  // namespace
}  // namespace usdlive::stage
