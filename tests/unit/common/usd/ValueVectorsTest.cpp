// Tests that the values of tests/vectors are those that OpenUSD reads from their text.
#include <gtest/gtest.h>
#include <pxr/usd/sdf/layer.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "MemoryBlobs.h"
#include "unit/common/Vectors.h"
#include "usdlive/common/usd/SdfLayerStore.h"

using namespace usdlive;
using namespace usdlive::test;

namespace {

const std::string kValues = vectorsFile("values.json");

}  // namespace

TEST(Vectors, ValuesEqualThoseOfOpenUsd) {
    auto file = nlohmann::ordered_json::parse(std::ifstream(kValues));
    ASSERT_FALSE(file["values"].empty());
    for (auto& sample : file["values"]) {
        SCOPED_TRACE(sample["name"]);
        const std::string path = sample["path"], field = sample["field"];
        const auto layer = pxr::SdfLayer::CreateAnonymous(".usda");
        ASSERT_TRUE(layer->ImportFromString(sample["usda"]));
        MemoryBlobs blobs;
        const auto read = usd::readLayer(layer, blobs);
        ASSERT_TRUE(read) << read.error().message;
        const FieldValue* content = read->field(path, field);
        ASSERT_TRUE(content);
        if (writesVectors() && !sample.contains("bytes"))
            sample["bytes"] = toHex(encodeFieldValue(*content));
        EXPECT_EQ(toHex(encodeFieldValue(*content)), sample["bytes"].get<std::string>());

        // And in the other direction: into a layer that does not have the field.
        const auto decoded = decodeFieldValue(fromHex(sample["bytes"]));
        ASSERT_TRUE(decoded) << decoded.error().message;
        const auto other = pxr::SdfLayer::CreateAnonymous(".usda");
        ASSERT_TRUE(other->ImportFromString(sample["usda"]));
        usd::SdfLayerStore store(other, blobs, nullptr);
        ASSERT_TRUE(store.apply(path, EraseField{field, {}}));
        ASSERT_TRUE(store.apply(path, SetField{field, {}, *decoded, {}}));
        std::string expected, written;
        ASSERT_TRUE(layer->ExportToString(&expected));
        ASSERT_TRUE(other->ExportToString(&written));
        EXPECT_EQ(written, expected);
    }
    if (writesVectors()) std::ofstream(kValues) << file.dump(1) << "\n";
}
