// Tests the hashes of fetched files.
#include "Digest.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>

using namespace usdlive::resolver;

namespace {

/// Adds the text in parts of at most `most` bytes.
void add(PartsDigest& digest, std::string_view text, std::size_t most) {
    while (!text.empty()) {
        const std::span<char> space = digest.space();
        const std::size_t size = text.copy(space.data(), std::min(space.size(), most));
        digest.add(size);
        EXPECT_EQ(std::string_view(space.data(), size), text.substr(0, size));
        text.remove_prefix(size);
    }
}

std::string hashInParts(std::string_view text, std::size_t most) {
    PartsDigest digest;
    add(digest, text, most);
    return digest.hex();
}

std::string randomText(std::size_t size) {
    std::mt19937 random{1};
    std::string text(size, '\0');
    for (char& byte : text) byte = char(random());
    return text;
}

}  // namespace

TEST(Digest, IsASha256) {
    Digest digest;
    digest.add("ab", 2);
    digest.add("c", 1);
    const std::string hash = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
    EXPECT_EQ(digest.hex(), hash);
    EXPECT_EQ(hashInParts("abc", 3), hash);
    EXPECT_EQ(hashInParts("abc", 1), hash);
    EXPECT_EQ(PartsDigest().hex(), Digest().hex());
}

TEST(Digest, OfPartsIsThatOfTheWhole) {
    constexpr std::size_t kAll = PartsDigest::kParts * PartsDigest::kPartBytes;
    const std::string text = randomText(3 * kAll + 5);
    Digest whole;
    whole.add(text.data(), text.size());
    const std::string hash = whole.hex();
    for (const std::size_t most : {PartsDigest::kPartBytes, std::size_t(10'007)})
        EXPECT_EQ(hashInParts(text, most), hash) << most;
}

TEST(Digest, OfPartsCanBeAbandoned) {
    const std::string text = randomText(PartsDigest::kParts * PartsDigest::kPartBytes);
    for (const std::size_t size : {std::size_t(0), std::size_t(1), text.size()}) {
        PartsDigest digest;
        add(digest, std::string_view(text).substr(0, size), PartsDigest::kPartBytes);
    }
}
