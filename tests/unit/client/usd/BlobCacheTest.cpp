#include "usdlive/client/usd/BlobCache.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <fstream>

using namespace usdlive;
using client::BlobCache;
namespace fs = std::filesystem;

namespace {

struct Folder {
    fs::path path = fs::temp_directory_path() / ("usdlive-blobs-" + std::to_string(getpid()));
    Folder() { fs::remove_all(path); }
    ~Folder() { fs::remove_all(path); }
};

SharedBytes bytes(std::uint8_t fill, std::size_t size = 1000) {
    return std::make_shared<const Bytes>(size, fill);
}
Hash hashOf(const SharedBytes& bytes) { return sha256(ByteView(*bytes)); }

}  // namespace

TEST(BlobCache, GivesBackWhatItKeepsAlsoToALaterOne) {
    const Folder folder;
    const auto blob = bytes(1);
    {
        BlobCache cache(folder.path);
        EXPECT_EQ(cache.blob(hashOf(blob)), nullptr);
        cache.keepBlob(hashOf(blob), blob);
        EXPECT_EQ(*cache.blob(hashOf(blob)), *blob);
    }
    BlobCache later(folder.path);
    ASSERT_TRUE(later.blob(hashOf(blob)));
    EXPECT_EQ(*later.blob(hashOf(blob)), *blob);
}

TEST(BlobCache, HoldsLittleInMemoryAndStillHasAll) {
    const Folder folder;
    BlobCache cache(folder.path, 2500);
    for (std::uint8_t i = 0; i < 20; ++i) cache.keepBlob(hashOf(bytes(i)), bytes(i));
    for (std::uint8_t i = 0; i < 20; ++i) {
        const auto blob = cache.blob(hashOf(bytes(i)));
        ASSERT_TRUE(blob) << int(i);
        EXPECT_EQ(*blob, *bytes(i));
    }
}

TEST(BlobCache, B3WhatIsHeldIsInMemoryOnlyUntilItIsKept) {
    const Folder folder;
    const auto blob = bytes(1), other = bytes(2);
    {
        BlobCache cache(folder.path);
        cache.holdBlob(hashOf(blob), blob);
        cache.holdBlob(hashOf(other), other);
        EXPECT_TRUE(cache.holds(hashOf(blob)));
        EXPECT_EQ(*cache.blob(hashOf(blob)), *blob);
        cache.keepBlob(hashOf(other), other);
    }
    BlobCache later(folder.path);
    EXPECT_FALSE(later.holds(hashOf(blob)));
    EXPECT_TRUE(later.holds(hashOf(other)));
    EXPECT_EQ(*later.blob(hashOf(other)), *other);
}

TEST(BlobCache, DoesNotTrustItsFiles) {
    const Folder folder;
    const auto blob = bytes(1);
    {
        BlobCache(folder.path).keepBlob(hashOf(blob), blob);
    }
    std::fstream(folder.path / hashOf(blob).hex()) << "x";
    BlobCache cache(folder.path);
    EXPECT_EQ(cache.blob(hashOf(blob)), nullptr);
    cache.keepBlob(hashOf(blob), blob);
    EXPECT_EQ(*cache.blob(hashOf(blob)), *blob);
}

TEST(BlobCache, KeepsInMemoryWhatItCannotWrite) {
    const Folder folder;
    std::ofstream(folder.path) << "a file, not a folder";
    BlobCache cache(folder.path, 1500);
    for (std::uint8_t i = 0; i < 5; ++i) cache.keepBlob(hashOf(bytes(i)), bytes(i));
    for (std::uint8_t i = 0; i < 5; ++i) EXPECT_TRUE(cache.blob(hashOf(bytes(i))));
}
