// Tests reading an SdfLayer into a LayerDoc.
#include <dlfcn.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <pxr/base/tf/refPtr.h>
#include <pxr/base/tf/token.h>
#include <pxr/base/vt/value.h>
#include <pxr/usd/sdf/abstractData.h>
#include <pxr/usd/sdf/data.h>
#include <pxr/usd/sdf/fileFormat.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/path.h>
#include <pxr/usd/sdf/primSpec.h>
#include <pxr/usd/sdf/schema.h>

#include <cstdlib>
#include <filesystem>

#include "MemoryBlobs.h"
#include "usdlive/common/usd/LayerFill.h"
#include "usdlive/common/usd/SdfLayerStore.h"

using namespace usdlive;
using namespace usdlive::usd;
using namespace pxr;
using testing::HasSubstr;
using usdlive::test::MemoryBlobs;
namespace fs = std::filesystem;

namespace {

// Stages of robots, cloth and machines from the package `newton`, which is installed beside
// usd-core.
fs::path newtonFolder() {
    if (const char* given = std::getenv("USDLIVE_NEWTON_DIR")) return given;
    Dl_info library{};
    dladdr(reinterpret_cast<const void*>(&SdfLayer::FindOrOpen), &library);
    if (!library.dli_fname) return {};
    return fs::path(library.dli_fname).parent_path().parent_path() / "newton";
}

std::vector<fs::path> newtonStages() {
    std::vector<fs::path> stages;
    std::error_code problem;
    for (const auto& entry : fs::recursive_directory_iterator(newtonFolder(), problem))
        if (entry.path().extension().native().starts_with(".usd")) stages.push_back(entry.path());
    std::ranges::sort(stages);
    return stages;
}

class FormatAccess : public SdfFileFormat {
public:
    using SdfFileFormat::_SetLayerData;
};

}  // namespace

// Each of these differs from the layer.
TEST(LayerReader, HoldsNothingElseThanTheDoc) {
    const auto layer = SdfLayer::CreateAnonymous(".usda");
    ASSERT_TRUE(
        layer->ImportFromString("#usda 1.0\n(\n    \"c\"\n)\n"
                                "def \"A\" {\n    double x = 1\n    int y = 2\n}\n"
                                "def \"B\" {\n}\n"));
    const VtValue points(VtArray<GfVec3f>(100'000, GfVec3f(1, 2, 3)));
    layer->SetField(SdfPath("/A.x"), TfToken("big"), points);
    MemoryBlobs blobs;
    const LayerDoc doc = *readLayer(layer, blobs);
    ASSERT_EQ(blobs.all.size(), 1U);
    EXPECT_TRUE(holds(layer, doc));
    const std::vector<std::pair<std::string, EditAction>> changes{
        {"/A.x", SetField{"default", {}, doubleValue(2)}},
        {"/A.x", EraseField{"default", {}}},
        {"/A.x", EraseField{"big", {}}},
        {"/", SetField{"comment", {}, stringValue("d")}},
        {"/A", SetField{"comment", {}, stringValue("d")}},
        {"/B", DeleteSpec{}},
        {"/A.y", MoveSpec{{"/A", {}}, "z"}},
        {"/A.z", CreateSpec{SpecKind::Attribute}},
        {"/A", MoveSpec{{"/B", {}}, "A"}}};
    for (const auto& [path, action] : changes) {
        LayerDoc other = doc;
        ASSERT_TRUE(other.apply(path, action)) << path;
        EXPECT_FALSE(holds(layer, other)) << path;
    }
    const auto swapped = SdfLayer::CreateAnonymous(".usda");
    swapped->TransferContent(layer);
    swapped->SetRootPrims(
        {swapped->GetPrimAtPath(SdfPath("/B")), swapped->GetPrimAtPath(SdfPath("/A"))});
    EXPECT_FALSE(holds(swapped, doc));
}

TEST(LayerReader, RealStagesComeBackAsTheyWere) {
    const auto stages = newtonStages();
    if (stages.empty()) GTEST_SKIP() << "no stages in " << newtonFolder();
    EXPECT_GT(stages.size(), 50U);
    for (const auto& stage : stages) {
        SCOPED_TRACE(stage);
        MemoryBlobs blobs;
        const auto layer = SdfLayer::OpenAsAnonymous(stage);
        ASSERT_TRUE(layer);
        std::string before;
        ASSERT_TRUE(layer->ExportToString(&before));
        const auto doc = readLayer(layer, blobs);
        ASSERT_TRUE(doc) << doc.error().message;
        for (const char* format : {"usda", "usdc"}) {
            const auto made = makeLayer(*doc, blobs, format);
            ASSERT_TRUE(made) << made.error().message;
            std::string after;
            ASSERT_TRUE((*made)->ExportToString(&after));
            ASSERT_TRUE(after == before) << format;
            EXPECT_TRUE(holds(*made, *doc)) << format;
            EXPECT_TRUE(*readLayer(*made, blobs) == *doc);
        }
    }
}

TEST(LayerReader, FieldsThatCannotBeCarriedAreNamed) {
    MemoryBlobs blobs;
    const auto layer = SdfLayer::CreateAnonymous(".usda");
    ASSERT_TRUE(layer->ImportFromString("#usda 1.0\ndef \"A\" {\ndouble x\n}\n"));
    layer->SetField(SdfPath("/A.x"), TfToken("documentation"), std::string("\xff"));
    const auto read = readLayer(layer, blobs);
    ASSERT_FALSE(read);
    EXPECT_EQ(read.error().code, ErrorCode::UnsupportedValue);
    EXPECT_THAT(read.error().message, HasSubstr("/A.x, field documentation"));
}

TEST(LayerReader, UnsupportedSpecsWithContentAreRefused) {
    MemoryBlobs blobs;
    const auto layer = SdfLayer::CreateAnonymous(".usda");
    const auto text = "#usda 1.0\ndef \"A\" {\nrel r = </B>\n}\n";
    ASSERT_TRUE(layer->ImportFromString(text));
    EXPECT_TRUE(readLayer(layer, blobs));
    layer->SetField(SdfPath("/A.r[/B]"), TfToken("comment"), std::string("on a target"));
    const auto read = readLayer(layer, blobs);
    ASSERT_FALSE(read);
    EXPECT_EQ(read.error().code, ErrorCode::UnsupportedValue);
    EXPECT_THAT(read.error().message, HasSubstr("/A.r[/B]"));
}

TEST(LayerReader, MissingChildrenMakeALayerUnreadable) {
    MemoryBlobs blobs;
    const auto layer = SdfLayer::CreateAnonymous(".usda");
    SdfAbstractDataRefPtr data = TfCreateRefPtr(new SdfData);
    data->CreateSpec(SdfPath("/"), SdfSpecTypePseudoRoot);
    data->Set(SdfPath("/"), SdfChildrenKeys->PrimChildren, VtValue(TfTokenVector{TfToken("A")}));
    FormatAccess::_SetLayerData(get_pointer(layer), data);
    const auto read = readLayer(layer, blobs);
    ASSERT_FALSE(read);
    EXPECT_EQ(read.error().code, ErrorCode::LayerUnreadable);
}
