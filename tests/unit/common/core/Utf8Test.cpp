// Tests the validation of UTF-8.
#include "usdlive/common/core/Utf8.h"

#include <gtest/gtest.h>

#include <string>

using namespace usdlive;

namespace {

const std::string kAscii = "abcdefgh";  // one step of the fast loop

// Encodes a code point by the definition, as simply as possible; surrogates are not allowed.
std::string encode(char32_t point) {
    const auto continuation = [&](int shift) { return char(0x80 | ((point >> shift) & 0x3F)); };
    if (point < 0x80) return {char(point)};
    if (point < 0x800) return {char(0xC0 | point >> 6), continuation(0)};
    if (point < 0x10000) return {char(0xE0 | point >> 12), continuation(6), continuation(0)};
    return {char(0xF0 | point >> 18), continuation(12), continuation(6), continuation(0)};
}

}  // namespace

TEST(Utf8, AcceptsEveryCodePointButNoSurrogate) {
    for (char32_t point = 0; point < 0x110000; ++point) {
        const std::string text = encode(point);
        const bool isSurrogate = point >= 0xD800 && point <= 0xDFFF;
        ASSERT_EQ(isUtf8(text), !isSurrogate) << std::hex << std::uint32_t(point);
        std::string_view rest = text;
        const auto taken = takeCodePoint(rest);
        if (isSurrogate) {
            ASSERT_FALSE(taken);
            ASSERT_EQ(rest, text);
        } else {
            ASSERT_EQ(taken, point);
            ASSERT_TRUE(rest.empty());
        }
    }
}

TEST(Utf8, RefusesMalformedText) {
    for (const std::string_view text :
         {"\x80", "\xBF", "\xC0\x80", "\xC1\xBF", "\xC2", "\xC2\x41", "\xE0\x9F\xBF", "\xE0\xA0",
          "\xE2\x28\xA1", "\xED\xA0\x80", "\xF0\x8F\xBF\xBF", "\xF0\x90\x80", "\xF4\x90\x80\x80",
          "\xF5\x80\x80\x80", "\xF8\x88\x80\x80\x80", "\xFE", "\xFF"}) {
        EXPECT_FALSE(isUtf8(text));
        EXPECT_FALSE(isUtf8(kAscii + std::string(text)));
        EXPECT_FALSE(isUtf8(std::string(text) + kAscii));
    }
    EXPECT_TRUE(isUtf8(""));
    EXPECT_TRUE(isUtf8(std::string_view("a\0b", 3)));
}

TEST(Utf8, QuotesForeignTextSoThatItCanBeShown) {
    EXPECT_EQ(inQuotes("a/b"), "'a/b'");
    EXPECT_EQ(inQuotes("a\n\x7F\xC2\x85z"), "'a???z'");
    EXPECT_EQ(inQuotes("\xFFz"), "'?z'");
    std::string eggs = "a";
    for (int count = 0; count < 1000; ++count) eggs += "\xC3\xA4";
    const std::string text = inQuotes(eggs);
    EXPECT_TRUE(isUtf8(text));
    EXPECT_LT(text.size(), 120U);
    EXPECT_TRUE(text.ends_with("...'"));
}
