// Tests metadata of plug-ins where only some processes have the plug-in.
#include <gtest/gtest.h>
#include <pxr/base/plug/registry.h>
#include <pxr/base/vt/dictionary.h>
#include <pxr/base/vt/value.h>
#include <pxr/usd/sdf/assetPath.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/schema.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "MemoryBlobs.h"
#include "usdlive/common/usd/LayerFill.h"
#include "usdlive/common/usd/SdfLayerStore.h"

using namespace usdlive;
using pxr::SdfPath;
using pxr::TfToken;

namespace {

constexpr const char* kPlugInfo =
    R"({"Plugins": [{"Name": "studio", "Type": "resource", "Root": ".",
"LibraryPath": "", "ResourcePath": ".", "Info": {"SdfMetadata": {
"sBool": {"type": "bool"}, "sInt": {"type": "int"}, "sDouble": {"type": "double"},
"sHalf": {"type": "half"}, "sString": {"type": "string"}, "sToken": {"type": "token"},
"sAsset": {"type": "asset"}, "sAssets": {"type": "asset[]"}, "sFloat3": {"type": "float3"},
"sQuat": {"type": "quatd"}, "sMatrix": {"type": "matrix2d"}, "sStrings": {"type": "string[]"},
"sEmpty": {"type": "int[]"}, "sPoints": {"type": "double3[]"}, "sTokens": {"type": "tokenlistop"},
"sInts": {"type": "intlistop"}, "sData": {"type": "dictionary"}, "sWrong": {"type": "int"},
"sOnlyOnLayers": {"type": "bool", "appliesTo": "layers"}}}}]})";

constexpr const char* kText = R"(#usda 1.0
(
    sBool = true
    sData = {
        int frames = 5
    }
    sOnlyOnLayers = true
)

def "A" (
    sBool = false
    sInt = -7
    sDouble = 1e-07
    sHalf = 0.5
    sString = """two
"lines" \\ """
    sToken = 'a "b"'
    sAsset = @./a b.png@
    sAssets = [@a@, @b c@]
    sFloat3 = (1, -inf, 0.25)
    sQuat = (1, 2, 3, 4)
    sMatrix = ( (1, 2), (3, 4) )
    sStrings = ["x, y", "]"]
    sEmpty = []
    sPoints = [(1, 2, 3), (4, 5, 6)]
    prepend sTokens = ["a", "b"]
    delete sTokens = ["c"]
    sInts = [1, 2]
    sData = {
        dictionary inner = {
            string who = "ada"
        }
    }
    sOnlyOnLayers = true
)
{
    double x (
        sBool = true
    )
    rel r (
        sBool = true
    )
}
)";

pxr::SdfLayerRefPtr opened() {
    auto layer = pxr::SdfLayer::CreateAnonymous(".usda");
    EXPECT_TRUE(layer->ImportFromString(kText));
    return layer;
}

SetField setKey(const char* key, Value value) {
    return {"sData", DictionaryKey{{"inner", key}}, std::move(value), {}};
}

}  // namespace

TEST(RegisteredMetadata, V11EqualsTheValueThatReadingTheFileGives) {
    usdlive::test::MemoryBlobs blobs;
    // This process does not know the fields yet, like a server without the studio's plug-ins.
    const auto unknowing = opened();
    const SdfPath a("/A");
    const TfToken data("sData");
    ASSERT_TRUE(unknowing->GetField(a, TfToken("sInt")).IsHolding<pxr::SdfUnregisteredValue>());
    LayerDoc doc = *usd::readLayer(unknowing, blobs);
    EXPECT_TRUE(doc.field("/A", "sData")->as<Dictionary>()) << "its keys merge";
    {  // An opened layer accepts keys, and so does one that was created from the doc.
        usd::SdfLayerStore store(unknowing, blobs, nullptr);
        const auto same = *usd::makeLayer(doc, blobs, "usda");
        usd::SdfLayerStore made(same, blobs, nullptr);
        for (const SetField& set :
             {setKey("one", stringValue("1")), setKey("two", boolValue(true))}) {
            ASSERT_TRUE(doc.apply("/A", set));
            ASSERT_TRUE(store.apply("/A", set));
            ASSERT_TRUE(made.apply("/A", set));
        }
        EXPECT_EQ(usd::readLayer(unknowing, blobs)->dump(), doc.dump());
        EXPECT_EQ(usd::readLayer(same, blobs)->dump(), doc.dump());
    }
    std::string text;
    ASSERT_TRUE(unknowing->ExportToString(&text));
    const auto exported = usd::exportText(doc, blobs);
    ASSERT_TRUE(exported) << exported.error().message;
    EXPECT_EQ(*exported, text);

    const auto folder =
        std::filesystem::temp_directory_path() / ("usdlive-metadata-" + std::to_string(getpid()));
    std::filesystem::create_directories(folder);
    std::ofstream(folder / "plugInfo.json") << kPlugInfo;
    ASSERT_EQ(pxr::PlugRegistry::GetInstance().RegisterPlugins(folder.string()).size(), 1u);
    std::filesystem::remove_all(folder);

    const auto read = pxr::SdfLayer::CreateAnonymous(".usda");
    ASSERT_TRUE(read->ImportFromString(text));
    const auto received = *usd::makeLayer(doc, blobs, "usda");
    std::size_t known = 0;
    for (const char* path : {"/", "/A", "/A.x", "/A.r"})
        for (const auto& name : doc.fieldNames(path)) {
            const SdfPath at(path);
            const TfToken field(name);
            EXPECT_EQ(received->GetField(at, field), read->GetField(at, field)) << path << name;
            known += !received->GetField(at, field).IsHolding<pxr::SdfUnregisteredValue>() &&
                     name.starts_with("s");
        }
    EXPECT_GE(known, 20u);
    EXPECT_EQ(received->GetField(a, TfToken("sInt")), pxr::VtValue(-7));
    EXPECT_TRUE(
        received->GetField(a, TfToken("sOnlyOnLayers")).IsHolding<pxr::SdfUnregisteredValue>());
    // A process without the plug-in writes the same text as one with it.
    std::string again;
    ASSERT_TRUE(received->ExportToString(&again));
    std::string ought;
    ASSERT_TRUE(read->ExportToString(&ought));
    EXPECT_EQ(again, ought);
    // A text that does not fit the type stays unchanged.
    ASSERT_TRUE(doc.apply("/A", SetField{"sWrong",
                                         {},
                                         Value(ValueType::Unregistered,
                                               [] {
                                                   Bytes bytes{0, 3, 0, 0, 0, 'a', 'b', 'c'};
                                                   return bytes;
                                               }()),
                                         {}}));
    EXPECT_TRUE((*usd::makeLayer(doc, blobs, "usdc"))
                    ->GetField(a, TfToken("sWrong"))
                    .IsHolding<pxr::SdfUnregisteredValue>());
}
