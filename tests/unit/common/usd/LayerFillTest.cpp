// Tests filling an SdfLayer from a LayerDoc, and exporting it.
#include "usdlive/common/usd/LayerFill.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <pxr/base/tf/notice.h>
#include <pxr/base/tf/weakBase.h>
#include <pxr/base/tf/weakPtr.h>
#include <pxr/base/vt/array.h>
#include <pxr/base/vt/value.h>
#include <pxr/usd/sdf/changeList.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/notice.h>
#include <pxr/usd/sdf/path.h>
#include <pxr/usd/sdf/pathExpression.h>
#include <pxr/usd/sdf/schema.h>

#include <filesystem>
#include <fstream>

#include "MemoryBlobs.h"
#include "usdlive/common/usd/SdfLayerStore.h"

using namespace usdlive;
using namespace usdlive::usd;
using namespace pxr;
using testing::HasSubstr;
using usdlive::test::MemoryBlobs;

namespace {

constexpr const char* kScene = R"(#usda 1.0
(
    "about"
    defaultPrim = "W"
    metersPerUnit = 2
    subLayers = [
        @a.usda@ (offset = 2)
    ]
)

def Xform "W" (
    append variantSets = "look"
    variants = {
        string look = "red"
    }
)
{
    def Sphere "S"
    {
        double radius = 4
        double radius.timeSamples = {
            1: 2,
            3: None,
        }
        double radius.connect = </W.other>
        rel r = [
            </W>,
            </W/S.radius>,
        ]
    }
    variantSet "look" = {
        "red" {
            def "InRed"
            {
            }

        }
    }
}

def "V"
{
}

)";

class ChangeCount : public TfWeakBase {
public:
    ChangeCount() { TfNotice::Register(TfCreateWeakPtr(this), &ChangeCount::handle); }
    std::size_t notices = 0, entries = 0;

private:
    void handle(const SdfNotice::LayersDidChange& notice) {
        ++notices;
        for (const auto& change : notice.GetChangeListVec())
            entries += change.second.GetEntryList().size();
    }
};

SdfLayerRefPtr fromText(const std::string& text) {
    const auto layer = SdfLayer::CreateAnonymous(".usda");
    EXPECT_TRUE(layer->ImportFromString(text));
    return layer;
}

std::string textOf(const SdfLayerRefPtr& layer) {
    std::string text;
    layer->ExportToString(&text);
    return text;
}

void fillWhole(const LayerDoc& doc, MemoryBlobs& blobs, SdfLayerStore& store) {
    LayerFill fill(store.layer(), blobs);
    fill.add(doc);
    const auto filled = fill.into(store);
    EXPECT_TRUE(filled) << filled.error().message;
}

}  // namespace

TEST(LayerFill, ACopyHasTheSameContentAndOneOfItsOwn) {
    const auto layer = SdfLayer::CreateAnonymous(".usda");
    ASSERT_TRUE(layer->ImportFromString(
        "#usda 1.0\n(\n    relocates = {\n        </W/a>: </W/b>\n    }\n)\n\ndef \"W\"\n{\n"
        "    double x = 1\n}\n"));
    const auto copy = copyOfLayer(*layer);
    std::string text, expected;
    ASSERT_TRUE(layer->ExportToString(&expected) && copy->ExportToString(&text));
    EXPECT_EQ(text, expected);
    EXPECT_TRUE(copy->GetHints().mightHaveRelocates);
    copy->SetField(SdfPath("/W.x"), SdfFieldKeys->Default, 2.0);
    EXPECT_EQ(layer->GetField(SdfPath("/W.x"), SdfFieldKeys->Default), VtValue(1.0));
}

TEST(LayerFill, FillsAnEmptyLayerWithFewChangeEntries) {
    MemoryBlobs blobs;
    const auto source = fromText(kScene);
    const LayerDoc doc = *readLayer(source, blobs);
    // A new layer, and one read from a file without prims, which has an empty list of them.
    for (const auto& layer : {SdfLayer::CreateAnonymous(".usda"), fromText("#usda 1.0\n")}) {
        SdfLayerStore store(layer, blobs, nullptr);
        ChangeCount changes;
        fillWhole(doc, blobs, store);
        EXPECT_EQ(textOf(layer), textOf(source));
        EXPECT_TRUE(*readLayer(layer, blobs) == doc);
        EXPECT_EQ(changes.notices, 1U);
        EXPECT_EQ(changes.entries, 3U);  // the pseudo-root and two root prims
        EXPECT_TRUE(layer->HasSpec(SdfPath("/W/S.r[/W]")));
        EXPECT_TRUE(layer->HasSpec(SdfPath("/W/S.radius[/W.other]")));
    }
}

TEST(LayerFill, ExistingContentSendsNoNotices) {
    MemoryBlobs blobs;
    const auto layer = fromText(kScene);
    const auto other = fromText(kScene);
    SdfLayerStore store(layer, blobs, nullptr);
    ChangeCount changes;
    fillWhole(*readLayer(other, blobs), blobs, store);
    EXPECT_EQ(changes.entries, 0U);
    other->SetField(SdfPath("/W/S.radius"), SdfFieldKeys->Default, 5.0);
    changes.entries = 0;
    fillWhole(*readLayer(other, blobs), blobs, store);
    EXPECT_EQ(changes.entries, 1U);
    EXPECT_EQ(textOf(layer), textOf(other));
}

// `==` treats them as equal; their texts, and other editors, show a difference.
TEST(LayerFill, TheSignOfZeroIsKept) {
    MemoryBlobs blobs;
    const auto with = [](const std::string& zero) {
        return fromText("#usda 1.0\n(\nstartTimeCode = " + zero +
                        "\n)\ndef \"A\" (customData = {\n" +
                        "dictionary d = {\ndouble x = " + zero + "\n}\n})\n{\ndouble s = " + zero +
                        "\nfloat3[] a = [(1, 2, " + zero + ")]\nmatrix2d m = ((1, " + zero +
                        "), (0, 1))\ndouble t.timeSamples = {\n1: " + zero + ",\n}\n}\n");
    };
    const auto layer = with("0"), other = with("-0");
    SdfLayerStore store(layer, blobs, nullptr);
    ChangeCount changes;
    fillWhole(*readLayer(other, blobs), blobs, store);
    EXPECT_EQ(textOf(layer), textOf(other));
    EXPECT_EQ(changes.entries, 6U);
}

TEST(LayerFill, ReplacesTheEarlierContent) {
    MemoryBlobs blobs;
    const auto layer =
        fromText("#usda 1.0\n(\n\"old\"\n)\ndef \"V\" {\nrel r = </Old>\n}\ndef \"Old\" {\n}\n");
    const auto source = fromText(kScene);
    SdfLayerStore store(layer, blobs, nullptr);
    fillWhole(*readLayer(source, blobs), blobs, store);
    EXPECT_EQ(textOf(layer), textOf(source));
    fillWhole(LayerDoc(), blobs, store);
    EXPECT_EQ(textOf(layer), textOf(SdfLayer::CreateAnonymous(".usda")));
}

TEST(LayerFill, SpecsComeInTheOrderOfTheirDocOnly) {
    MemoryBlobs blobs;
    const auto layer = SdfLayer::CreateAnonymous(".usda");
    const auto filled = [&](auto... specs) {
        LayerFill fill(layer, blobs);
        EXPECT_TRUE(fill.addSpec(kRootNode, 0, 0, SpecKind::PseudoRoot, ""));
        EXPECT_TRUE(fill.addSpec(2, kRootNode, 5, SpecKind::Prim, "A"));
        return (specs(fill).has_value() && ...);
    };
    const auto add = [](NodeId node, NodeId parent, std::uint64_t order, SpecKind kind,
                        const char* name) {
        return [=](LayerFill& fill) { return fill.addSpec(node, parent, order, kind, name); };
    };
    constexpr auto kPrim = SpecKind::Prim, kAttribute = SpecKind::Attribute;
    EXPECT_TRUE(filled(add(3, 2, 1, kPrim, "B"), add(4, 2, 2, kPrim, "C"),
                       add(5, 2, 1, kAttribute, "a"), add(6, kRootNode, 6, kPrim, "D")));
    EXPECT_FALSE(filled(add(3, kRootNode, 4, kPrim, "before")));
    EXPECT_FALSE(filled(add(3, kRootNode, 5, kPrim, "beside")));
    EXPECT_FALSE(filled(add(3, 9, 1, kPrim, "ofNobody")));
    EXPECT_FALSE(filled(add(3, kRootNode, 6, kPrim, "B"), add(4, 2, 1, kPrim, "ofOneThatIsDone")));
    EXPECT_FALSE(filled(add(3, 2, 1, kAttribute, "a"), add(4, 2, 1, kPrim, "afterAttributes")));
    EXPECT_FALSE(filled(add(3, kRootNode, 6, kAttribute, "ofTheRoot")));
    EXPECT_FALSE(filled(add(3, 0, 0, SpecKind::PseudoRoot, "")));
}

TEST(LayerFill, OneUnsupportedFieldDoesNotAffectOthers) {
    MemoryBlobs blobs;
    LayerDoc doc = *readLayer(fromText(kScene), blobs);
    const Value bad(ValueType::Path, stringValue("/A//B").bytes());
    ASSERT_TRUE(doc.apply("/W", SetField{"assetInfo", {}, FieldValue(bad)}));
    const auto layer = SdfLayer::CreateAnonymous(".usda");
    SdfLayerStore store(layer, blobs, nullptr);
    LayerFill fill(layer, blobs);
    fill.add(doc);
    const auto filled = fill.into(store);
    ASSERT_FALSE(filled);
    EXPECT_THAT(filled.error().message, HasSubstr("/W, field assetInfo"));
    EXPECT_EQ(textOf(layer), textOf(fromText(kScene)));
    // A file would silently lack it.
    const auto made = makeLayer(doc, blobs, "usda");
    ASSERT_FALSE(made);
    EXPECT_EQ(made.error().code, ErrorCode::InvalidValue);
}

TEST(LayerFill, V9MissingBlobsComeLater) {
    MemoryBlobs blobs, away;
    const VtValue big(VtArray<double>(40'000, 2.5));
    const FieldValue value = *encodeValue(big, away);
    LayerDoc doc;
    ASSERT_TRUE(doc.apply("/A", CreateSpec{SpecKind::Prim}));
    ASSERT_TRUE(doc.apply("/A", SetField{"customData", DictionaryKey{{"k"}}, value}));
    const auto layer = SdfLayer::CreateAnonymous(".usda");
    SdfLayerStore store(layer, blobs, nullptr);
    fillWhole(doc, blobs, store);
    EXPECT_TRUE(store.waitsForBlobs());
    EXPECT_FALSE(layer->HasField(SdfPath("/A"), SdfFieldKeys->CustomData));
    const auto made = makeLayer(doc, blobs, "usda");
    ASSERT_FALSE(made);
    EXPECT_EQ(made.error().code, ErrorCode::BlobNotFound);

    const auto [hash, bytes] = *away.all.begin();
    blobs.keepBlob(hash, bytes);
    store.blobArrived(hash, [&](const std::string& path, const std::string& field) {
        return doc.field(path, field);
    });
    EXPECT_FALSE(store.waitsForBlobs());
    EXPECT_TRUE(*readLayer(layer, blobs) == doc);
    EXPECT_TRUE(makeLayer(doc, blobs, "usda"));
}

TEST(LayerFill, ALayerKeepsItsKindOfData) {
    MemoryBlobs blobs;
    const LayerDoc doc = *readLayer(fromText(kScene), blobs);
    const auto folder = std::filesystem::temp_directory_path() / "usdlive-layer-fill";
    std::filesystem::create_directories(folder);
    const auto path = (folder / "placeholder.usd").string();
    std::ofstream(path) << "#usda 1.0\n";
    const auto layer = SdfLayer::FindOrOpen(path);
    ASSERT_TRUE(layer);
    ASSERT_FALSE(layer->StreamsData());
    SdfLayerStore store(layer, blobs, nullptr);
    for (int times = 0; times < 2; ++times) {  // into an empty layer, and over existing content
        fillWhole(doc, blobs, store);
        EXPECT_FALSE(layer->StreamsData());
        EXPECT_TRUE(*readLayer(layer, blobs) == doc);
    }
    std::filesystem::remove_all(folder);
}

TEST(LayerFill, V9ABlobThatArrivesBeforeTheContentIsUsed) {
    MemoryBlobs blobs, away;
    const VtValue big(VtArray<double>(40'000, 2.5));
    LayerDoc doc;
    ASSERT_TRUE(doc.apply("/A", CreateSpec{SpecKind::Prim}));
    ASSERT_TRUE(
        doc.apply("/A", SetField{"customData", DictionaryKey{{"k"}}, *encodeValue(big, away)}));
    const auto layer = SdfLayer::CreateAnonymous(".usda");
    LayerFill fill(layer, blobs);
    fill.add(doc);
    blobs.all = away.all;
    SdfLayerStore store(layer, blobs, nullptr);
    ASSERT_TRUE(fill.into(store));
    EXPECT_FALSE(store.waitsForBlobs());
    EXPECT_TRUE(*readLayer(layer, blobs) == doc);
}

TEST(ExportText, IsWhatALayerOfThatContentExports) {
    MemoryBlobs blobs;
    const auto layer = fromText(kScene);
    const auto text = exportText(*readLayer(layer, blobs), blobs);
    ASSERT_TRUE(text) << text.error().message;
    EXPECT_EQ(*text, textOf(layer));
    EXPECT_EQ(*exportText(LayerDoc(), blobs), textOf(SdfLayer::CreateAnonymous(".usda")));
}

// ED7 drops exactly the fields that no text can hold.
TEST(ExportText, ED7FieldsOfTheOtherKindOfPropertyDoNotSurviveIt) {
    MemoryBlobs blobs;
    const auto samples = [](const Value& value) { return TimeSamples{{{1, value}}}; };
    const auto paths = *encodeValue(VtValue(SdfPathListOp::CreateExplicit({SdfPath("/B")})), blobs);
    const FieldValue one = doubleValue(1), path = pathValue("/B"), token = tokenValue("double");
    const std::pair<const char*, FieldValue> fields[] = {{"default", one},
                                                         {"default", path},
                                                         {"timeSamples", samples(doubleValue(1))},
                                                         {"targetPaths", paths},
                                                         {"connectionPaths", paths},
                                                         {"timeSamples", samples(pathValue("/B"))},
                                                         {"typeName", token},
                                                         {"displayName", stringValue("x")},
                                                         {"noLoadHint", boolValue(true)}};
    for (const auto& [field, value] : fields) {
        LayerDoc doc;
        ASSERT_TRUE(doc.apply("/A", CreateSpec{SpecKind::Prim}));
        ASSERT_TRUE(doc.apply("/A.r", CreateSpec{SpecKind::Relationship}));
        LayerDoc authored = doc;
        const SetField set{field, {}, value};
        ASSERT_TRUE(doc.apply("/A.r", set));
        const auto text = exportText(doc, blobs);
        const bool survives = text && *readLayer(fromText(*text), blobs) == doc;
        const auto applied = authored.apply("/A.r", set, LayerDoc::By::Author);
        const auto refused = applied ? std::nullopt : std::optional(applied.error().code);
        EXPECT_EQ(refused, survives ? std::nullopt : std::optional(ErrorCode::SpecKindConflict))
            << field;
    }
}

TEST(ExportText, RefusesTextThatCannotBeReadBack) {
    MemoryBlobs blobs;
    LayerDoc doc;
    ASSERT_TRUE(doc.apply("/A", CreateSpec{SpecKind::Prim}));
    const auto expression = *encodeValue(VtValue(SdfPathExpression("//x")), blobs);
    ASSERT_TRUE(doc.apply("/A", SetField{"customData", DictionaryKey{{"k"}}, expression}));
    testing::internal::CaptureStderr();
    const auto text = exportText(doc, blobs);
    EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
    ASSERT_FALSE(text);
    EXPECT_EQ(text.error().code, ErrorCode::SaveFailed);
    EXPECT_THAT(text.error().message, HasSubstr("/A"));

    LayerDoc typeless;
    ASSERT_TRUE(typeless.apply("/A", CreateSpec{SpecKind::Prim}));
    ASSERT_TRUE(typeless.apply("/A.x", CreateSpec{SpecKind::Attribute}));
    EXPECT_FALSE(exportText(typeless, blobs));
}
