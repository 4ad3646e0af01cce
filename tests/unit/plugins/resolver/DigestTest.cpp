// Tests the hashes of fetched files.
#include "Digest.h"

#include <gtest/gtest.h>

using namespace usdlive::resolver;

TEST(Digest, IsASha256) {
    Digest digest;
    digest.add("ab", 2);
    digest.add("c", 1);
    EXPECT_EQ(digest.hex(), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
}
