#include "usdlive/client/usd/BlobCache.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <chrono>
#include <deque>
#include <fstream>
#include <thread>

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

TEST(BlobCache, ItsFolderIsBoundedAndTheLastUsedStay) {
    const Folder folder;
    {
        BlobCache cache(folder.path, 0, 10'000);
        for (std::uint8_t i = 0; i < 100; ++i) cache.cacheBlob(hashOf(bytes(i)), bytes(i));
    }
    BlobCache later(folder.path);
    EXPECT_TRUE(later.blob(hashOf(bytes(99))));
    EXPECT_FALSE(later.blob(hashOf(bytes(0))));
    const auto files = std::distance(fs::directory_iterator(folder.path), {});
    EXPECT_LE(files, 11);
    EXPECT_GE(files, 5);
}

TEST(BlobCache, WhatIsKeptStaysWhateverOthersRemove) {
    const Folder folder;
    BlobCache mine(folder.path, 0, 5'000);
    mine.keepBlob(hashOf(bytes(1)), bytes(1));
    for (std::uint8_t i = 2; i < 50; ++i) mine.keepBlob(hashOf(bytes(i)), bytes(i));
    {
        BlobCache other(folder.path, 0, 3'000);
        for (std::uint8_t i = 50; i < 150; ++i) other.cacheBlob(hashOf(bytes(i)), bytes(i));
    }
    for (std::uint8_t i = 1; i < 50; ++i) {
        const auto blob = mine.blob(hashOf(bytes(i)));
        ASSERT_TRUE(blob) << int(i);
        EXPECT_EQ(*blob, *bytes(i));
    }
    mine.releaseKept();
    const auto own = [&] {
        std::size_t count = 0;
        for (const auto& entry : fs::recursive_directory_iterator(folder.path))
            count += entry.path().parent_path() != folder.path ? 1 : 0;
        return count;
    };
    for (int wait = 0; wait < 1'000 && own() > 0; ++wait)
        std::this_thread::sleep_for(std::chrono::milliseconds(5));
    EXPECT_EQ(own(), 0u);
}

TEST(BlobCache, SeveralMayWriteTheSameAtOnce) {
    const Folder folder;
    {
        std::deque<BlobCache> caches;
        for (int i = 0; i < 4; ++i) caches.emplace_back(folder.path, 0, 1'000'000'000);
        for (std::uint8_t i = 0; i < 50; ++i)
            for (BlobCache& cache : caches) {
                cache.keepBlob(hashOf(bytes(i, 100'000)), bytes(i, 100'000));
                cache.cacheBlob(hashOf(bytes(100 + i, 100'000)), bytes(100 + i, 100'000));
            }
    }
    BlobCache later(folder.path);
    for (std::uint8_t i = 0; i < 50; ++i) {
        EXPECT_TRUE(later.blob(hashOf(bytes(i, 100'000))));
        EXPECT_TRUE(later.blob(hashOf(bytes(100 + i, 100'000))));
    }
    EXPECT_EQ(std::distance(fs::directory_iterator(folder.path), {}), 100)
        << "nothing else is left";
}

TEST(BlobCache, WhatAKilledProcessLeftIsRemoved) {
    const Folder folder;
    fs::create_directories(folder.path / "own-dead");
    std::ofstream(folder.path / "own-dead.lock");
    std::ofstream(folder.path / "own-dead" / "value") << "x";
    std::ofstream(folder.path / "other.part") << "x";
    fs::last_write_time(folder.path / "other.part",
                        fs::file_time_type::clock::now() - std::chrono::hours(2));
    BlobCache(folder.path, 0, 1'000'000);
    EXPECT_EQ(std::distance(fs::directory_iterator(folder.path), {}), 0);
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
