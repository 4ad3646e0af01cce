// Tests reading and writing of little-endian bytes.
#include "usdlive/common/core/ByteStream.h"

#include <gtest/gtest.h>

using namespace usdlive;

TEST(ByteStream, ReadsWhatWasWrittenLittleEndian) {
    Bytes bytes;
    appendNumber<std::uint16_t>(bytes, 0x0102);
    appendNumber<double>(bytes, -1.5);
    appendText(bytes, "abc");
    appendNumber<std::int64_t>(bytes, -7);
    EXPECT_EQ(bytes[0], 2);
    EXPECT_EQ(bytes[1], 1);

    ByteReader in(bytes);
    EXPECT_EQ(in.u16(), 0x0102);
    EXPECT_EQ(in.f64(), -1.5);
    EXPECT_EQ(in.text(), "abc");
    EXPECT_FALSE(in.finished());
    EXPECT_EQ(in.i64(), -7);
    EXPECT_TRUE(in.finished());
}

TEST(ByteStream, StaysFailedAfterReadingPastTheEnd) {
    const Bytes bytes{1, 2, 3};
    ByteReader in(bytes);
    EXPECT_EQ(in.u32(), 0U);
    EXPECT_TRUE(in.failed());
    EXPECT_EQ(in.left(), 0U);
    EXPECT_EQ(in.u8(), 0U) << "nothing is read after a failure";
    EXPECT_FALSE(in.finished());
}

TEST(ByteStream, ReadsNoMoreThanThereIs) {
    Bytes bytes;
    appendNumber<std::uint32_t>(bytes, 0xFFFFFFFF);
    bytes.push_back('a');
    ByteReader text(bytes);
    EXPECT_EQ(text.text(), "");
    EXPECT_TRUE(text.failed());

    ByteReader in(bytes);
    EXPECT_TRUE(in.take(0xFFFF'FFFF'FFFF'FFFFU).empty());
    EXPECT_TRUE(in.failed());

    ByteReader none(ByteView{});
    EXPECT_TRUE(none.take(0).empty());
    EXPECT_TRUE(none.finished());
}
