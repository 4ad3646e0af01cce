// Tests Capture: the edits that it makes of an editor's writes to an SdfLayer.
#include "usd/live/Capture.h"

#include <gtest/gtest.h>
#include <pxr/base/gf/vec3f.h>
#include <pxr/base/tf/errorMark.h>
#include <pxr/base/vt/array.h>
#include <pxr/base/vt/dictionary.h>
#include <pxr/base/vt/value.h>
#include <pxr/usd/sdf/attributeSpec.h>
#include <pxr/usd/sdf/changeBlock.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/layerOffset.h>
#include <pxr/usd/sdf/listOp.h>
#include <pxr/usd/sdf/namespaceEdit.h>
#include <pxr/usd/sdf/pathExpression.h>
#include <pxr/usd/sdf/primSpec.h>
#include <pxr/usd/sdf/relationshipSpec.h>
#include <pxr/usd/sdf/schema.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>

#include "unit/Seeds.h"
#include "unit/client/usd/RandomEditor.h"
#include "unit/common/usd/MemoryBlobs.h"

using namespace usdlive;
using client::AuthoredEdit;
using client::Capture;

namespace {

std::string text(const pxr::SdfLayerHandle& layer) {
    std::string exported;
    layer->ExportToString(&exported);
    return exported;
}

// A layer that an editor writes, the model that a session would keep, and a layer that follows.
class Loopback : public ::testing::Test {
protected:
    void SetUp() override { start(pxr::SdfLayer::CreateAnonymous(".usda")); }

    void start(const pxr::SdfLayerRefPtr& written) {
        writer.reset();
        layer = written;
        model = *usd::readLayer(layer, blobs);
        follower = pxr::SdfLayer::CreateAnonymous(".usda");
        follower->TransferContent(layer);
        capture = std::make_unique<Capture>(id, [this] { return &model; });
        writer = std::make_unique<usd::SdfLayerStore>(layer, blobs, capture.get());
        reader = std::make_unique<usd::SdfLayerStore>(follower, blobs, nullptr);
    }

    // Seals the frame, and applies the edits like a session and another editor.
    std::vector<AuthoredEdit> seal() {
        const pxr::TfErrorMark complaints;
        auto sealed = capture->seal(*writer, blobs);
        lost = std::move(sealed.lost);
        for (const auto& edit : sealed.edits) {
            const auto applied = model.apply(edit.path, edit.action);
            EXPECT_TRUE(applied) << edit.path << ": " << applied.error().message;
            const auto shown = reader->apply(edit.path, edit.action);
            EXPECT_TRUE(shown) << edit.path << ": " << shown.error().message;
        }
        EXPECT_FALSE(capture->hasWrites());
        for (const auto& complaint : complaints) ADD_FAILURE() << complaint.GetCommentary();
        return std::move(sealed.edits);
    }

    void expectSame() {
        EXPECT_EQ(text(layer), text(follower));
        const auto read = usd::readLayer(layer, blobs);
        ASSERT_TRUE(read) << read.error().message;
        EXPECT_EQ(read->dump(), model.dump());
    }

    pxr::SdfPrimSpecHandle prim(const std::string& name) {
        return pxr::SdfPrimSpec::New(layer, name, pxr::SdfSpecifierDef);
    }
    pxr::SdfAttributeSpecHandle attribute(const pxr::SdfPrimSpecHandle& owner) {
        return pxr::SdfAttributeSpec::New(owner, "x", pxr::SdfValueTypeNames->Double);
    }

    const LayerId id{"shot.usda"};
    usdlive::test::MemoryBlobs blobs;
    LayerDoc model;
    pxr::SdfLayerRefPtr layer, follower;
    std::unique_ptr<Capture> capture;
    std::unique_ptr<usd::SdfLayerStore> writer, reader;
    std::vector<Capture::LostWrite> lost;
};

using CaptureTest = Loopback;

}  // namespace

TEST_F(CaptureTest, CapturesNothingWhenNothingWasWritten) {
    EXPECT_FALSE(capture->hasWrites());
    EXPECT_TRUE(seal().empty());
}

TEST_F(CaptureTest, AValueSetManyTimesIsOneEdit) {
    const auto x = attribute(prim("A"));
    seal();
    for (int i = 0; i < 100; ++i) x->SetDefaultValue(pxr::VtValue(double(i)));
    const auto edits = seal();
    ASSERT_EQ(edits.size(), 1u);
    EXPECT_EQ(edits[0].path, "/A.x");
    EXPECT_EQ(std::get<SetField>(edits[0].action).field, "default");
    expectSame();
}

TEST_F(CaptureTest, AValueSetBackMakesNoEdit) {
    const auto x = attribute(prim("A"));
    x->SetDefaultValue(pxr::VtValue(1.0));
    seal();
    x->SetDefaultValue(pxr::VtValue(2.0));
    x->SetDefaultValue(pxr::VtValue(1.0));
    EXPECT_TRUE(seal().empty());
}

TEST_F(CaptureTest, ASpecCreatedAndDeletedMakesNoEdit) {
    prim("A");
    seal();
    layer->RemoveRootPrim(prim("B"));
    EXPECT_TRUE(seal().empty());
    expectSame();
}

TEST_F(CaptureTest, DeletingATreeIsOneEdit) {
    pxr::SdfCreatePrimInLayer(layer, pxr::SdfPath("/A/B/C"));
    attribute(layer->GetPrimAtPath(pxr::SdfPath("/A/B")));
    seal();
    layer->Clear();
    const auto edits = seal();
    ASSERT_EQ(edits.size(), 1u);
    EXPECT_EQ(edits[0].path, "/A");
    EXPECT_TRUE(std::holds_alternative<DeleteSpec>(edits[0].action));
    expectSame();
}

TEST_F(CaptureTest, ARenameIsOneEditAndCarriesEarlierWrites) {
    const auto a = prim("A");
    const auto x = attribute(a);
    prim("B");
    seal();
    x->SetDefaultValue(pxr::VtValue(3.0));
    a->SetName("C");
    const auto edits = seal();
    ASSERT_EQ(edits.size(), 2u);
    EXPECT_EQ(edits[0].path, "/A");
    EXPECT_EQ(std::get<MoveSpec>(edits[0].action).name, "C");
    EXPECT_EQ(edits[1].path, "/C.x");
    expectSame();
}

TEST_F(CaptureTest, AReparentIntoTheMiddleIsAMoveAndAPlace) {
    for (const auto* path : {"/P/A", "/P/B", "/P/C", "/Q"})
        pxr::SdfCreatePrimInLayer(layer, pxr::SdfPath(path));
    seal();
    pxr::SdfBatchNamespaceEdit batch;
    batch.Add(pxr::SdfPath("/Q"), pxr::SdfPath("/P/Q"), 1);
    ASSERT_TRUE(layer->Apply(batch));
    const auto edits = seal();
    ASSERT_EQ(edits.size(), 2u);
    EXPECT_EQ(std::get<MoveSpec>(edits[0].action).parent.path, "/P");
    EXPECT_EQ(edits[1].path, "/P/Q");
    EXPECT_EQ(std::get<PlaceSpec>(edits[1].action).before, "B");
    expectSame();
}

TEST_F(CaptureTest, OnlyTheWrittenSampleOfManyIsCaptured) {
    const auto x = attribute(prim("A"));
    for (int i = 0; i < 50; ++i) layer->SetTimeSample(x->GetPath(), i, double(i));
    seal();
    layer->SetTimeSample(x->GetPath(), 7, 70.0);
    layer->EraseTimeSample(x->GetPath(), 8);
    layer->SetTimeSample(x->GetPath(), 9, 9.0);  // the value that it has already
    const auto edits = seal();
    ASSERT_EQ(edits.size(), 2u);
    EXPECT_EQ(std::get<SampleTime>(std::get<SetField>(edits[0].action).part).time, 7);
    EXPECT_EQ(std::get<SampleTime>(std::get<EraseField>(edits[1].action).part).time, 8);
    expectSame();
}

TEST_F(CaptureTest, ADictionaryIsCapturedByKeys) {
    const auto a = prim("A");
    layer->SetFieldDictValueByKey(a->GetPath(), pxr::SdfFieldKeys->CustomData, pxr::TfToken("a:b"),
                                  1);
    layer->SetFieldDictValueByKey(a->GetPath(), pxr::SdfFieldKeys->CustomData, pxr::TfToken("a:c"),
                                  2);
    seal();
    layer->SetFieldDictValueByKey(a->GetPath(), pxr::SdfFieldKeys->CustomData, pxr::TfToken("a:c"),
                                  3);
    const auto edits = seal();
    ASSERT_EQ(edits.size(), 1u);
    EXPECT_EQ(std::get<DictionaryKey>(std::get<SetField>(edits[0].action).part).path,
              (std::vector<std::string>{"a", "c"}));
    // A value at the place of a nested key is replaced, and emptied dictionaries disappear.
    layer->SetFieldDictValueByKey(a->GetPath(), pxr::SdfFieldKeys->CustomData,
                                  pxr::TfToken("a:c:d"), 4);
    seal();
    expectSame();
    layer->EraseFieldDictValueByKey(a->GetPath(), pxr::SdfFieldKeys->CustomData,
                                    pxr::TfToken("a:c:d"));
    seal();
    expectSame();
    layer->EraseFieldDictValueByKey(a->GetPath(), pxr::SdfFieldKeys->CustomData,
                                    pxr::TfToken("a:b"));
    seal();
    expectSame();
}

TEST_F(CaptureTest, TwoListItemsAreTwoEditsOfOneField) {
    const auto r = pxr::SdfRelationshipSpec::New(prim("A"), "r");
    r->GetTargetPathList().Prepend(pxr::SdfPath("/X"));
    seal();
    r->GetTargetPathList().Append(pxr::SdfPath("/Y"));
    const auto edits = seal();
    ASSERT_EQ(edits.size(), 1u);
    EXPECT_TRUE(std::holds_alternative<ListItem>(std::get<SetField>(edits[0].action).part));
    expectSame();
}

TEST_F(CaptureTest, ASublayersOffsetIsPartOfIt) {
    layer->InsertSubLayerPath("./a.usda");
    layer->InsertSubLayerPath("./b.usda");
    seal();
    layer->SetSubLayerOffset(pxr::SdfLayerOffset(3, 2), 1);
    const auto edits = seal();
    ASSERT_EQ(edits.size(), 1u);
    EXPECT_EQ(std::get<SetField>(edits[0].action).field, "subLayers");
    expectSame();
}

TEST_F(CaptureTest, AnUnsupportedValueIsReportedAndUndone) {
    const auto a = prim("A");
    const auto x = attribute(a);
    x->SetDefaultValue(pxr::VtValue(1.0));
    seal();
    layer->SetField(x->GetPath(), pxr::TfToken("customData"),
                    pxr::VtValue(pxr::VtDictionary{{"ours", pxr::VtValue(pxr::VtDictionary())},
                                                   {"theirs", pxr::VtValue(std::vector<int>{1})}}));
    const auto edits = seal();
    EXPECT_TRUE(edits.empty());
    ASSERT_EQ(lost.size(), 1u);
    EXPECT_EQ(lost[0].reason.code, ErrorCode::UnsupportedValue);
    EXPECT_EQ(lost[0].path, "/A.x");
    EXPECT_EQ(lost[0].field, "customData");
    EXPECT_NE(lost[0].reason.message.find("shot.usda </A.x> customData: "), std::string::npos);
    EXPECT_FALSE(capture->hasWrites());
    expectSame();
}

// The message has only the beginning of its text.
TEST_F(CaptureTest, AnUnsupportedValueIsKeptAsItsWholeText) {
    const auto a = prim("A");
    seal();
    const std::string text(100'000, 'x');
    layer->SetField(a->GetPath(), pxr::TfToken("assetInfo"),
                    pxr::VtValue(pxr::VtDictionary{{"ours", pxr::VtValue(text)},
                                                   {"theirs", pxr::VtValue(std::vector<int>{1})}}));
    EXPECT_TRUE(seal().empty());
    ASSERT_EQ(lost.size(), 1u);
    EXPECT_LT(lost[0].reason.message.size(), 2'000u);
    ASSERT_EQ(lost[0].edits.size(), 1u);
    const auto& kept = std::get<SetField>(lost[0].edits[0].action);
    EXPECT_EQ(kept.field, "customData");
    EXPECT_EQ(std::get<DictionaryKey>(kept.part).path,
              (std::vector<std::string>{"lost", "assetInfo"}));
    EXPECT_NE(std::string(textOf(*kept.value.as<Value>()).value()).find(text), std::string::npos);
    expectSame();
}

// D1: such a value would hang the composition of everybody.
TEST_F(CaptureTest, AForbiddenValueIsReportedAndUndone) {
    layer->SetTimeCodesPerSecond(30);
    seal();
    layer->SetTimeCodesPerSecond(0);
    EXPECT_TRUE(seal().empty());
    ASSERT_EQ(lost.size(), 1u);
    EXPECT_EQ(lost[0].reason.code, ErrorCode::ForbiddenValue);
    EXPECT_EQ(layer->GetTimeCodesPerSecond(), 30);
    expectSame();
}

TEST_F(CaptureTest, ED8ATypeNameThatNoTextHoldsIsReportedAndUndone) {
    const auto a = prim("A");
    const auto x = attribute(a);
    seal();
    a->SetTypeName("My Type");
    layer->SetField(x->GetPath(), pxr::SdfFieldKeys->TypeName, pxr::TfToken("None"));
    const auto y = attribute(prim("B"));
    layer->SetField(y->GetPath(), pxr::SdfFieldKeys->TypeName, pxr::TfToken("My Type"));
    seal();
    ASSERT_EQ(lost.size(), 3u);
    for (const auto& write : lost) EXPECT_EQ(write.reason.code, ErrorCode::InvalidValue);
    EXPECT_EQ(a->GetTypeName(), pxr::TfToken());
    EXPECT_EQ(x->GetTypeName(), pxr::SdfValueTypeNames->Double);
    EXPECT_TRUE(layer->GetPrimAtPath(pxr::SdfPath("/B")));
    EXPECT_FALSE(layer->GetAttributeAtPath(pxr::SdfPath("/B.x")))
        << "there is no attribute without a type";
    expectSame();
}

TEST_F(CaptureTest, ED9AValueOfAnotherTypeIsReportedAndUndone) {
    const auto x = attribute(prim("A"));
    x->SetDefaultValue(pxr::VtValue(1.0));
    seal();
    layer->SetField(x->GetPath(), pxr::SdfFieldKeys->Default, std::string("text"));
    layer->SetField(x->GetPath(), pxr::SdfFieldKeys->TimeSamples,
                    pxr::SdfTimeSampleMap{{1, pxr::VtValue(pxr::GfVec3f(1))}});
    EXPECT_TRUE(seal().empty());
    ASSERT_EQ(lost.size(), 2u);
    EXPECT_NE(lost[0].reason.message.find("double"), std::string::npos) << lost[0].reason.message;
    EXPECT_EQ(x->GetDefaultValue(), pxr::VtValue(1.0));
    expectSame();
    // With its type set as well, the value fits.
    layer->SetField(x->GetPath(), pxr::SdfFieldKeys->Default, std::string("text"));
    layer->SetField(x->GetPath(), pxr::SdfFieldKeys->TypeName, pxr::TfToken("string"));
    EXPECT_EQ(seal().size(), 2u);
    EXPECT_TRUE(lost.empty());
    expectSame();
}

TEST_F(CaptureTest, ED10AFieldWithoutMeaningIsAbsent) {
    const auto a = prim("A");
    seal();
    layer->SetField(a->GetPath(), pxr::SdfFieldKeys->VariantSetNames,
                    pxr::SdfStringListOp::CreateExplicit());
    layer->SetField(a->GetPath(), pxr::SdfFieldKeys->InheritPaths, pxr::SdfPathListOp());
    layer->SetField(a->GetPath(), pxr::SdfFieldKeys->VariantSelection,
                    pxr::SdfVariantSelectionMap());
    EXPECT_TRUE(seal().empty());
    EXPECT_TRUE(lost.empty());
    expectSame();
}

TEST_F(CaptureTest, AValueThatOpenUsdReadsDifferentlyIsReportedAndUndone) {
    const auto a = prim("A");
    const auto e = pxr::SdfAttributeSpec::New(a, "e", pxr::SdfValueTypeNames->PathExpression);
    seal();
    const auto set = [&](const char* text) {
        e->SetDefaultValue(pxr::VtValue(pxr::SdfPathExpression(text)));
        return seal().size();
    };
    EXPECT_EQ(set("/a{x(-0.0)}"), 0u);
    ASSERT_EQ(lost.size(), 1u);
    EXPECT_EQ(lost[0].reason.code, ErrorCode::UnsupportedValue);
    EXPECT_FALSE(e->HasDefaultValue());
    EXPECT_EQ(set("/a{x(0.5)}"), 1u);
    // ED11. Sdf itself refuses it from some callers only.
    layer->SetFieldDictValueByKey(a->GetPath(), pxr::SdfFieldKeys->CustomData, pxr::TfToken("path"),
                                  pxr::VtValue(pxr::SdfPath("/A")));
    EXPECT_TRUE(seal().empty());
    ASSERT_EQ(lost.size(), 1u);
    EXPECT_EQ(lost[0].reason.code, ErrorCode::InvalidValue);
    expectSame();
}

TEST_F(CaptureTest, ED12ATextWithANulIsReportedAndUndoneAlone) {
    const auto a = prim("A");
    const auto s = pxr::SdfAttributeSpec::New(a, "s", pxr::SdfValueTypeNames->StringArray);
    seal();
    for (const std::size_t count : {std::size_t(1), std::size_t(100'000)}) {  // inline, and a blob
        s->SetDefaultValue(pxr::VtValue(pxr::VtStringArray(count, std::string("a\0b", 3))));
        a->SetComment("c" + std::to_string(count));
        EXPECT_EQ(seal().size(), 1u);
        ASSERT_EQ(lost.size(), 1u);
        EXPECT_NE(lost[0].reason.message.find("holds a NUL"), std::string::npos);
        EXPECT_FALSE(s->HasDefaultValue());
    }
    expectSame();
}

TEST_F(CaptureTest, ABigValueIsNamedByItsHash) {
    const auto p = pxr::SdfAttributeSpec::New(prim("A"), "p", pxr::SdfValueTypeNames->DoubleArray);
    p->SetDefaultValue(pxr::VtValue(pxr::VtArray<double>(100'000, 1.5)));
    const auto edits = seal();
    const auto blobs = std::count_if(edits.begin(), edits.end(), [](const AuthoredEdit& edit) {
        const auto* set = std::get_if<SetField>(&edit.action);
        const auto* value = set ? set->value.as<Value>() : nullptr;
        return value && value->isBlob();
    });
    EXPECT_EQ(blobs, 1);
    expectSame();
}

TEST_F(CaptureTest, AReplacementWithoutDetailsIsComparedAsAWhole) {
    pxr::SdfCreatePrimInLayer(layer, pxr::SdfPath("/A/B"));
    attribute(layer->GetPrimAtPath(pxr::SdfPath("/A")));
    prim("C");
    seal();
    {
        // Changes the layer without the capture's knowledge.
        writer.reset();
        layer->ImportFromString(
            "#usda 1.0\n(\n \"new\"\n)\nclass \"C\" {\n rel x\n}\ndef \"A\" {\n rel x\n "
            "def \"D\" {\n double y = 1\n }\n}\n");
        writer = std::make_unique<usd::SdfLayerStore>(layer, blobs, capture.get());
    }
    capture->contentReplaced();
    EXPECT_FALSE(seal().empty());
    expectSame();
}

TEST_F(CaptureTest, ImportReplacesASpecByOneOfAnotherKind) {
    layer->ImportFromString("#usda 1.0\ndef \"A\" {\n double x = 1\n}\n");
    seal();
    layer->ImportFromString("#usda 1.0\ndef \"A\" {\n rel x = </B>\n}\n");
    seal();
    expectSame();
    layer->ImportFromString("#usda 1.0\ndef \"A\" {\n double x = 1\n}\n");
    seal();
    expectSame();
}

// Any edits of an editor, in ticks of random length.
TEST_F(CaptureTest, FollowsAnyEditing) {
    const char* given = std::getenv("USDLIVE_CAPTURE_SEEDS");
    const unsigned seeds = given ? unsigned(std::atoi(given)) : seedsOf(150);
    const char* first = std::getenv("USDLIVE_CAPTURE_FIRST");
    const unsigned from = first ? unsigned(std::atoi(first)) : 0;
    for (unsigned seed = from; seed < from + seeds; ++seed) {
        SCOPED_TRACE(seed);  // a failure prints the seed that repeats it
        start(pxr::SdfLayer::CreateAnonymous(".usda"));
        tests::RandomEditor editor(layer, seed);
        std::mt19937 random(seed + 1);
        std::string tick;
        for (int step = 0; step < 120; ++step) {
            if (random() % 4 == 0) {
                const pxr::SdfChangeBlock block;
                for (int i = 0; i < 3; ++i) tick += editor.step() + "; ";
            } else {
                tick += editor.step() + "; ";
            }
            if (random() % 3) continue;
            SCOPED_TRACE(tick);
            seal();
            EXPECT_TRUE(lost.empty()) << lost.front().reason.message;
            expectSame();
            if (HasFailure()) return;
            tick.clear();
        }
    }
}
