// Tests the names of uploaded files (FI7).
#include "usdlive/common/core/FilePath.h"

#include <gtest/gtest.h>

#include <string>
#include <string_view>

using namespace usdlive;

TEST(FilePath, FI7TakesRelativeNamesOfFilesThatAreNoLayers) {
    for (const std::string_view text :
         {"a.png", "tex/brick.<UDIM>.exr", "a/b/c/d.vdb", "with space/ä ö.jpg", "car.usdz",
          "no_ending", "mesh.obj", "shot.usda/tex.png", "a..b/x.png", "x.usda.txt", "usd", "a.abc"})
        EXPECT_TRUE(checkFilePath(text)) << text;
    EXPECT_TRUE(checkFilePath(std::string(1020, 'a') + ".png"));
}

TEST(FilePath, FI7RefusesNamesOutsideTheProjectHiddenOnesAndLayers) {
    using namespace std::string_view_literals;
    for (const std::string_view text : {""sv,
                                        "/a.png"sv,
                                        "a//b.png"sv,
                                        "a/"sv,
                                        "./a.png"sv,
                                        "../a.png"sv,
                                        "a/../b.png"sv,
                                        ".."sv,
                                        "."sv,
                                        ".usdlive/store"sv,
                                        "a/.usdlive/x.png"sv,
                                        ".hidden.png"sv,
                                        "a/.b/c.png"sv,
                                        "a\\b.png"sv,
                                        "c:a.png"sv,
                                        "a\nb.png"sv,
                                        "a\0b.png"sv,
                                        "a\x80.png"sv,
                                        "\xff.png"sv,
                                        "a.usd"sv,
                                        "a.usda"sv,
                                        "tex/A.USDC"sv,
                                        ".usd"sv}) {
        const auto valid = checkFilePath(text);
        ASSERT_FALSE(valid) << text;
        EXPECT_EQ(valid.error().code, ErrorCode::InvalidFileName) << text;
    }
    EXPECT_FALSE(checkFilePath(std::string(1021, 'a') + ".png"));
}

TEST(FilePath, FI7TheMessageOfALayerSaysWhatToDo) {
    EXPECT_NE(checkFilePath("shot.usda").error().message.find("create_layer"), std::string::npos);
    EXPECT_NE(checkFilePath("tex/").error().message.find("names a folder"), std::string::npos);
}
