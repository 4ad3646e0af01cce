// Tests value clips: the order of strength, clips that cannot be used, and edits of clips.
#include "usd/stage/Clips.h"

#include <gtest/gtest.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/schema.h>

#include <string>
#include <vector>

#include "usdlive/client/usd/stage/Stage.h"

namespace usdlive::stage {
namespace {

using pxr::SdfPath;
using pxr::VtValue;
using Times = std::vector<double>;

const SdfPath kNumber("/Shot/Part.number");

pxr::SdfLayerRefPtr read(const std::string& text) {
    auto layer = pxr::SdfLayer::CreateAnonymous(".usda");
    EXPECT_TRUE(layer->ImportFromString("#usda 1.0\n" + text));
    return layer;
}

pxr::SdfLayerRefPtr clip(const std::string& samples) {
    return read("def \"Clip\" {\ndef \"Part\" {\ndouble number.timeSamples = {" + samples +
                "}\n}\n}\n");
}

// A weak layer with a default and a layer above it with the clips.
class ClipsTest : public testing::Test {
protected:
    void open(const std::string& clips, const std::string& above = "") {
        weak_ = read("def \"Shot\" {\ndef \"Part\" {\ndouble number = -1\n}\n}\n");
        strong_ = read("(subLayers = [@" + weak_->GetIdentifier() +
                       "@])\nover \"Shot\" (clips = {\ndictionary a = {\n" + clips +
                       "\n}\n}) {\nover \"Part\" {\n" + above + "\n}\n}\n");
        stage_ = std::make_unique<Stage>(strong_);
    }

    [[nodiscard]] std::string twoClips() const {
        return "string primPath = \"/Clip\"\nasset[] assetPaths = [@" + first_->GetIdentifier() +
               "@, @" + second_->GetIdentifier() + "@]\ndouble2[] active = [(0, 0), (10, 1)]\n";
    }

    [[nodiscard]] AttributeQuery query() const { return stage_->property(kNumber).query(); }

    pxr::SdfLayerRefPtr first_ = clip("0: 0, 4: 4, 20: 100"), second_ = clip("10: 50, 12: 70");
    pxr::SdfLayerRefPtr weak_, strong_;
    std::unique_ptr<Stage> stage_;
};

TEST_F(ClipsTest, ClipsAreStrongerThanWeakerLayersOnly) {
    open(twoClips());
    EXPECT_EQ(query().source(), ValueSource::ValueClips);
    EXPECT_EQ(query().timeSamples(), (Times{0, 4, 10, 12}));
    EXPECT_EQ(query().get(2), VtValue(2.0));
    EXPECT_EQ(query().get(11), VtValue(60.0));
    EXPECT_EQ(query().getDefault(), VtValue(-1.0));
    EXPECT_TRUE(stage_->usedLayers().contains(second_));

    open(twoClips(), "double number = 3");
    EXPECT_EQ(query().get(2), VtValue(3.0));
}

TEST_F(ClipsTest, TimesOfAClipMayJump) {
    open(twoClips() + "double2[] times = [(0, 0), (4, 4), (4, 0), (8, 4)]");
    EXPECT_EQ(query().get(3), VtValue(3.0));
    EXPECT_EQ(query().get(4), VtValue(0.0));
    EXPECT_EQ(query().get(6), VtValue(2.0));
}

TEST_F(ClipsTest, ClipsThatCannotBeUsedAreLeftOut) {
    const std::string paths = "asset[] assetPaths = [@" + first_->GetIdentifier() + "@]\n";
    const std::string range =
        "double templateStartTime = 0\ndouble templateEndTime = 1e9\n"
        "double templateStride = 1\n";
    std::string deep;
    for (int i = 0; i < 1000; ++i) deep += "/a";
    for (const auto& clips :
         {paths + "string primPath = \"/Clip\"", twoClips() + "double2[] active = [(0, 7)]",
          twoClips() + "string primPath = \"\"", twoClips() + "string primPath = \"Clip\"",
          twoClips() + "string primPath = \"" + deep + "\"",
          "string primPath = \"/Clip\"\nstring templateAssetPath = \"./c.usda\"\n" + range,
          "string primPath = \"/Clip\"\nstring templateAssetPath = \"./c.#.usda\"\n" + range}) {
        SCOPED_TRACE(clips);
        open(clips);
        EXPECT_EQ(query().get(2), VtValue(-1.0));
    }
}

TEST_F(ClipsTest, AMissingClipHasNoValues) {
    open(twoClips() + "asset[] assetPaths = [@gone.usda@, @" + second_->GetIdentifier() + "@]");
    EXPECT_TRUE(query().get(2).IsEmpty());
    EXPECT_EQ(query().get(12), VtValue(70.0));
}

TEST_F(ClipsTest, EditsOfClipsChangeValuesAndAreNotified) {
    open(twoClips());
    std::vector<StageChanges> changes;
    const auto subscription =
        stage_->subscribe([&](const StageChanges& one) { changes.push_back(one); });
    EXPECT_EQ(query().get(2), VtValue(2.0));

    first_->SetTimeSample(SdfPath("/Clip/Part.number"), 2, VtValue(9.0));
    ASSERT_EQ(changes.size(), 1);
    EXPECT_TRUE(changes[0].changedInfo.contains(kNumber));
    EXPECT_EQ(query().get(2), VtValue(9.0));

    strong_->EraseField(SdfPath("/Shot"), pxr::SdfFieldKeys->Clips);
    ASSERT_EQ(changes.size(), 2);
    EXPECT_TRUE(changes[1].resynced.contains(SdfPath("/Shot")));
    EXPECT_EQ(query().get(2), VtValue(-1.0));
}

}  // namespace
}  // namespace usdlive::stage
