// Tests the names of layers (LN1).
#include "usdlive/common/core/LayerPath.h"

#include <gtest/gtest.h>

#include <string>

#include "usdlive/common/core/Utf8.h"

using namespace usdlive;

TEST(LayerPath, LN1TakesRelativeNamesOfUsdFiles) {
    for (const std::string_view text :
         {"a.usd", "a.usda", "shot/anim.usdc", "a/b/c/d.usd", "with space/ä ö.usda", "a.b.c.usda",
          ".hidden/x.usd", "a..b/x.usd", "...usda", "x.usd/y.usd", "_.usdlive/a.usd", "A.USDA",
          "a.Usdc"}) {
        const auto id = parseLayerId(text);
        ASSERT_TRUE(id) << id.error().message;
        EXPECT_EQ(id->value, text);
    }
}

TEST(LayerPath, LN1RefusesNamesOutsideTheProject) {
    using namespace std::string_view_literals;
    for (const std::string_view text : {""sv,
                                        "/a.usd"sv,
                                        "a//b.usd"sv,
                                        "a/"sv,
                                        "a.usd/"sv,
                                        "./a.usd"sv,
                                        "../a.usd"sv,
                                        "a/../b.usd"sv,
                                        "a/./b.usd"sv,
                                        ".."sv,
                                        "."sv,
                                        ".usdlive/a.usd"sv,
                                        "a/.usdlive2/a.usd"sv,
                                        ".usdlive.usda"sv,
                                        "a\\b.usd"sv,
                                        "c:a.usd"sv,
                                        "a.usd:SDF_FORMAT_ARGS:x=1"sv,
                                        "a\nb.usd"sv,
                                        "a\0b.usd"sv,
                                        "a\x7F.usd"sv,
                                        "a\xC2\x85.usd"sv,
                                        "a\xFF.usd"sv,
                                        "a.txt"sv,
                                        "a.usdz"sv,
                                        "usda"sv,
                                        ".usda"sv,
                                        "b/.usd"sv,
                                        "a.usd "sv}) {
        const auto id = parseLayerId(text);
        ASSERT_FALSE(id) << text;
        EXPECT_EQ(id.error().code, ErrorCode::InvalidLayerName);
        EXPECT_TRUE(isUtf8(id.error().message));
    }
}

TEST(LayerPath, LN1RefusesNamesAbove1024Bytes) {
    EXPECT_TRUE(parseLayerId(std::string(1020, 'a') + ".usd"));
    EXPECT_FALSE(parseLayerId(std::string(1021, 'a') + ".usd"));
}
