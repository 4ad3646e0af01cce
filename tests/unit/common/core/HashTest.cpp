// Tests Hash and SHA-256.
#include "usdlive/common/core/Hash.h"

#include <gtest/gtest.h>

#include <string>
#include <unordered_set>

using namespace usdlive;

// The samples are those of FIPS 180-4.
TEST(Hash, IsSha256) {
    EXPECT_EQ(sha256(ByteView{}).hex(),
              "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
    EXPECT_EQ(sha256(asBytes("abc")).hex(),
              "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
    EXPECT_EQ(sha256(asBytes("abcdbcdecdefdefgefghfghighijhijkijkljklmklmnlmnomnopnopq")).hex(),
              "248d6a61d20638b8e5c026930c3e6039a33ce45964ff2167f6ecedd419db06c1");
    EXPECT_EQ(sha256(asBytes(std::string(1'000'000, 'a'))).hex(),
              "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0");
}

TEST(Hash, OfPartsIsThatOfThePartsOneAfterTheOther) {
    EXPECT_EQ(sha256({asBytes("a"), ByteView{}, asBytes("bc")}), sha256(asBytes("abc")));
    EXPECT_EQ(sha256({}), sha256(ByteView{}));
}

TEST(Hash, OrdersAndFindsByItsBytes) {
    const Hash first = sha256(asBytes("a")), second = sha256(asBytes("b"));
    EXPECT_NE(first, second);
    EXPECT_EQ(first < second, first.hex() < second.hex());
    const std::unordered_set<Hash> known{first};
    EXPECT_TRUE(known.contains(sha256(asBytes("a"))));
    EXPECT_FALSE(known.contains(second));
}
