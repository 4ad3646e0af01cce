// Tests OthersWrites: who has written a register of a layer last.
#include "usd/content/OthersWrites.h"

#include <gtest/gtest.h>
#include <pxr/usd/sdf/attributeSpec.h>
#include <pxr/usd/sdf/primSpec.h>
#include <pxr/usd/sdf/types.h>

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "usdlive/client/usd/content/Recorder.h"

namespace usdlive::content {

namespace {

Edit set(const std::string& path, const std::string& field, FieldPart part = {}) {
    return {LayerId{"a.usda"}, {path, {}}, SetField{field, std::move(part), {}, ValueType::None}};
}
Change change(const std::string& path, const std::string& field, Part part = {}) {
    return {pxr::SdfPath(path), pxr::TfToken(field), std::move(part), {}, {}};
}

class OthersWritesTest : public testing::Test {
protected:
    const pxr::SdfLayerRefPtr layer = pxr::SdfLayer::CreateAnonymous(".usda");
    const std::shared_ptr<OthersWrites> others = OthersWrites::of(layer);
};

}  // namespace

TEST_F(OthersWritesTest, ExistsForALayerWhileSomebodyKeepsIt) {
    EXPECT_EQ(OthersWrites::of(layer), others);
    const auto other = pxr::SdfLayer::CreateAnonymous(".usda");
    EXPECT_FALSE(OthersWrites::find(other));
    const auto kept = OthersWrites::of(other);
    EXPECT_EQ(OthersWrites::find(other), kept);
}

TEST_F(OthersWritesTest, NotesRegistersApart) {
    others->note(set("/A", "customData", DictionaryKey{{"deep", "theirs"}}), 5);
    others->note(set("/A.x", "timeSamples", SampleTime{2}), 6);
    EXPECT_EQ(others->last(), 6);
    using Keys = std::vector<std::string>;
    EXPECT_TRUE(others->wroteRegister(change("/A", "customData", Keys{"deep", "theirs"}), 4));
    EXPECT_FALSE(others->wroteRegister(change("/A", "customData", Keys{"deep", "theirs"}), 5));
    EXPECT_FALSE(others->wroteRegister(change("/A", "customData", Keys{"deep", "mine"}), 4));
    EXPECT_TRUE(others->wroteRegister(change("/A.x", "timeSamples", 2.0), 5));
    EXPECT_FALSE(others->wroteRegister(change("/A.x", "timeSamples", 3.0), 5));
    others->note(set("/A", "customData", DictionaryKey{{"deep"}}), 7);
    EXPECT_TRUE(others->wroteRegister(change("/A", "customData", Keys{"deep", "mine"}), 6));
    EXPECT_TRUE(others->wroteSpec(pxr::SdfPath("/A"), 6));
    EXPECT_FALSE(others->changedSpec(pxr::SdfPath("/A"), 0));
}

TEST_F(OthersWritesTest, AWriteThatWasCommittedBeforeTheOwnOneIsNotTheLast) {
    others->note(set("/A.x", "default"), 8);
    others->noteOwn(set("/A.x", "default"), 7);
    EXPECT_FALSE(others->wroteRegister(change("/A.x", "default"), 7));
    others->note(set("/A.x", "default"), 10);
    others->noteOwn(set("/A.x", "default"), 10);  // made when the other one had arrived
    EXPECT_TRUE(others->wroteRegister(change("/A.x", "default"), 9));
}

TEST_F(OthersWritesTest, ASpecThatWasMovedIsChangedAtBothPlaces) {
    others->note({LayerId{"a.usda"}, {"/A/B", {}}, MoveSpec{{"/C", {}}, "D"}}, 3);
    EXPECT_TRUE(others->changedSpec(pxr::SdfPath("/A/B"), 2));
    EXPECT_TRUE(others->changedSpec(pxr::SdfPath("/C/D"), 2));
    EXPECT_TRUE(others->wroteRegister(change("/C/D", "comment"), 2));
}

TEST_F(OthersWritesTest, NotesFollowASpecThatIsMoved) {
    const auto move = [](const std::string& from, const std::string& name) {
        return Edit{LayerId{"a.usda"}, {from, {}}, MoveSpec{{"/", {}}, name}};
    };
    others->note(set("/A/B.x", "default"), 2);
    others->note(set("/A.x", "default"), 2);
    others->note(set("/A{v=p}B", "comment"), 2);
    others->note(set("/AB.x", "default"), 2);
    others->note(move("/A", "C"), 3);
    EXPECT_TRUE(others->wroteRegister(change("/C/B.x", "default"), 1));
    EXPECT_TRUE(others->wroteRegister(change("/C.x", "default"), 1));
    EXPECT_TRUE(others->wroteRegister(change("/C{v=p}B", "comment"), 1));
    EXPECT_FALSE(others->wroteRegister(change("/A/B.x", "default"), 1));
    EXPECT_TRUE(others->wroteRegister(change("/AB.x", "default"), 1));
    others->noteOwn(move("/C", "A"), 3);
    EXPECT_TRUE(others->wroteRegister(change("/A/B.x", "default"), 1));
    EXPECT_FALSE(others->wroteRegister(change("/C/B.x", "default"), 1));
}

TEST_F(OthersWritesTest, TimesAreExact) {
    others->note(set("/A.x", "timeSamples", SampleTime{1.0}), 5);
    others->note(set("/A.x", "timeSamples", SampleTime{0.0}), 5);
    EXPECT_FALSE(others->wroteRegister(change("/A.x", "timeSamples", 1.0000000001), 4));
    EXPECT_TRUE(others->wroteRegister(change("/A.x", "timeSamples", 1.0), 4));
    EXPECT_TRUE(others->wroteRegister(change("/A.x", "timeSamples", -0.0), 4));
}

// The layer was joined again from a snapshot while it had what the undo restored, or something
// else.
TEST_F(OthersWritesTest, RedoLeavesWhatOthersHaveWrittenWhileCommitsWereMissed) {
    const pxr::SdfPath x("/A.x"), y("/A.y");
    const pxr::TfToken field("default");
    for (const auto& path : {x, y}) {
        pxr::SdfJustCreatePrimAttributeInLayer(layer, path, pxr::SdfValueTypeNames->Double);
        layer->SetField(path, field, 0.0);
    }
    const auto edit = [&] {
        Recorder recorder;
        recorder.touch(layer, pxr::SdfPath("/A"), true);
        for (const auto& path : {x, y}) layer->SetField(path, field, 1.0);
        return recorder.finish();
    };
    const Record::IsShared shared = [](const auto&) { return true; };
    Record first = edit();
    EXPECT_FALSE(first.isFollowed(layer));
    EXPECT_TRUE(first.undo(shared).empty());
    layer->SetField(x, field, 7.0);
    others->missed(9);
    EXPECT_TRUE(first.isFollowed(layer));
    Record again = edit();
    const auto kept = again.keepOthers(first, shared);
    ASSERT_EQ(kept.size(), 1u);
    EXPECT_EQ(kept[0].path, x);
    EXPECT_EQ(layer->GetField(x, field), pxr::VtValue(7.0));
    EXPECT_EQ(layer->GetField(y, field), pxr::VtValue(1.0));
}

TEST_F(OthersWritesTest, TheNumberOfNotesIsBounded) {
    for (std::size_t i = 0; i <= OthersWrites::kMostRegisters; ++i)
        others->note(set("/A.x" + std::to_string(i), "default"), 1 + i);
    EXPECT_TRUE(others->wroteRegister(change("/B.x", "default"), 0));
    EXPECT_FALSE(others->wroteRegister(change("/B.x", "default"), others->last()));
}

TEST_F(OthersWritesTest, AValueThatOthersWroteAgainIsKept) {
    const pxr::SdfPath x("/A.x");
    const pxr::TfToken field("default");
    pxr::SdfJustCreatePrimAttributeInLayer(layer, x, pxr::SdfValueTypeNames->Double);
    layer->SetField(x, field, pxr::VtValue(1.0));
    Recorder recorder;
    recorder.touch(layer, x);
    layer->SetField(x, field, pxr::VtValue(2.0));
    const Record record = recorder.finish();
    others->note(set("/A.x", "default"), 4);
    const auto kept = record.undo([](const auto&) { return true; });
    ASSERT_EQ(kept.size(), 1);
    EXPECT_EQ(kept[0].path, x);
    EXPECT_EQ(layer->GetField(x, field), pxr::VtValue(2.0));
    EXPECT_TRUE(record.undo([](const auto&) { return false; }).empty());
    EXPECT_EQ(layer->GetField(x, field), pxr::VtValue(1.0));
}

}  // namespace usdlive::content
