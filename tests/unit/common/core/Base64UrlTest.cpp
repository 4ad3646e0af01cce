// Tests that each content has exactly one text in base64url.
#include "usdlive/common/core/Base64Url.h"

#include <gtest/gtest.h>

#include <string>

namespace usdlive {
namespace {

std::optional<std::string> decoded(std::string_view text) {
    const auto bytes = base64UrlDecoded(text);
    return bytes ? std::optional(std::string(bytes->begin(), bytes->end())) : std::nullopt;
}

TEST(Base64Url, DecodesEachLength) {
    EXPECT_EQ(decoded(""), "");
    EXPECT_EQ(decoded("Zg"), "f");
    EXPECT_EQ(decoded("Zm8"), "fo");
    EXPECT_EQ(decoded("Zm9v"), "foo");
    EXPECT_EQ(decoded("-_-_"), "\xfb\xff\xbf");
}

TEST(Base64Url, EachContentHasOneText) {
    for (const char* wrong : {"Z", "Zm9vZ", "Zh", "Zm9", "Zg=", "Zg==", "Zm8=", "Zm 9v", "Zm9v\n",
                              "+/+/", "Z\xc3", "Zm9v."})
        EXPECT_FALSE(decoded(wrong)) << wrong;
}

}  // namespace
}  // namespace usdlive
