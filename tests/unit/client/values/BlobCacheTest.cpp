// Tests BlobCache: big values in memory and in a bounded, shared folder.
#include "values/BlobCache.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <chrono>
#include <deque>
#include <fstream>
#include <set>
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

SharedBytes bytes(int fill, std::size_t size = 1000) {
    return std::make_shared<const Bytes>(size, std::uint8_t(fill));
}
Hash hashOf(const SharedBytes& bytes) { return sha256(ByteView(*bytes)); }
// Returns the names of values in folders that belong to one cache.
std::set<std::string> ownFiles(const Folder& folder) {
    std::set<std::string> found;
    std::error_code ignored;  // another thread removes files meanwhile
    for (fs::recursive_directory_iterator entry(folder.path, ignored), end; entry != end;
         entry.increment(ignored))
        if (entry->path().parent_path() != folder.path)
            found.insert(entry->path().filename().string());
    return found;
}

}  // namespace

TEST(BlobCache, ReturnsCachedValuesAlsoToALaterCache) {
    const Folder folder;
    const auto blob = bytes(1);
    {
        BlobCache cache(folder.path);
        EXPECT_EQ(cache.blob(hashOf(blob)), nullptr);
        cache.cacheBlob(hashOf(blob), blob);
        EXPECT_EQ(*cache.blob(hashOf(blob)), *blob);
    }
    BlobCache later(folder.path);
    ASSERT_TRUE(later.blob(hashOf(blob)));
    EXPECT_EQ(*later.blob(hashOf(blob)), *blob);
}

TEST(BlobCache, HoldsLittleInMemoryAndHasAllValues) {
    const Folder folder;
    BlobCache cache(folder.path, 2500);
    for (std::uint8_t i = 0; i < 20; ++i) cache.keepBlob(hashOf(bytes(i)), bytes(i));
    for (std::uint8_t i = 0; i < 20; ++i) {
        const auto blob = cache.blob(hashOf(bytes(i)));
        ASSERT_TRUE(blob) << int(i);
        EXPECT_EQ(*blob, *bytes(i));
    }
}

TEST(BlobCache, B3AHeldValueStaysInMemoryUntilItIsKept) {
    const Folder folder;
    const auto blob = bytes(1), other = bytes(2);
    {
        BlobCache cache(folder.path);
        cache.holdBlob(hashOf(blob), blob);
        cache.holdBlob(hashOf(other), other);
        EXPECT_TRUE(cache.holds(hashOf(blob)));
        EXPECT_EQ(*cache.blob(hashOf(blob)), *blob);
        cache.cacheBlob(hashOf(other), other);
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

TEST(BlobCache, KeptValuesStayWhenOthersRemoveTheirs) {
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
    mine.keepOnly({}, {});
    for (int wait = 0; wait < 1'000 && !ownFiles(folder).empty(); ++wait)
        std::this_thread::sleep_for(std::chrono::milliseconds(5));
    EXPECT_TRUE(ownFiles(folder).empty());
}

// The intermediate values of a drag: values that work still names are kept, and values that the
// server has are cached.
TEST(BlobCache, B7OnlyNamedValuesAreKept) {
    const Folder folder;
    {
        BlobCache cache(folder.path, 0, 1'000'000'000);
        std::set<Hash> named, stored;
        for (int round = 0; round < 5; ++round) {
            for (std::uint8_t i = 0; i < 40; ++i)
                cache.keepBlob(hashOf(bytes(40 * round + i)), bytes(40 * round + i));
            named = {hashOf(bytes(40 * round + 39))};
            stored = {hashOf(bytes(40 * round + 5))};
            cache.keepOnly(named, stored);
            EXPECT_EQ(cache.kept(), 1u);
        }
        const std::set<std::string> last{hashOf(bytes(199)).hex()};
        for (int wait = 0; wait < 1'000 && ownFiles(folder) != last; ++wait)
            std::this_thread::sleep_for(std::chrono::milliseconds(5));
        EXPECT_EQ(ownFiles(folder), last);
        EXPECT_EQ(*cache.blob(hashOf(bytes(199))), *bytes(199));
        EXPECT_TRUE(cache.holds(hashOf(bytes(199))));
        // A value that is released and written again is kept.
        cache.keepOnly({}, {});
        cache.keepBlob(hashOf(bytes(199)), bytes(199));
        EXPECT_EQ(*cache.blob(hashOf(bytes(199))), *bytes(199));
        cache.keepOnly({}, {hashOf(bytes(199))});
    }
    BlobCache later(folder.path);
    for (const std::uint8_t number : {5, 45, 85, 125, 165, 199})
        EXPECT_TRUE(later.blob(hashOf(bytes(number)))) << int(number);
    EXPECT_EQ(std::distance(fs::directory_iterator(folder.path), {}), 6) << "nothing else is left";
}

TEST(BlobCache, WithoutAWritableFolderOnlyKeptValuesStayInMemory) {
    const Folder folder;
    std::ofstream(folder.path) << "in the way";
    BlobCache cache(folder.path, 5'000, 1'000'000'000);
    std::set<Hash> own, others;
    for (int i = 0; i < 20; ++i) {
        cache.keepBlob(hashOf(bytes(i)), bytes(i));
        own.insert(hashOf(bytes(i)));
    }
    for (int i = 20; i < 120; ++i) {
        cache.cacheBlob(hashOf(bytes(i)), bytes(i));
        others.insert(hashOf(bytes(i)));
    }
    const auto held = [&](const std::set<Hash>& hashes) {
        return std::ranges::count_if(hashes, [&](const Hash& hash) { return cache.holds(hash); });
    };
    for (int wait = 0; wait < 1'000 && held(others) > 5; ++wait)
        std::this_thread::sleep_for(std::chrono::milliseconds(5));
    EXPECT_LE(held(others), 5);
    for (const Hash& hash : own) EXPECT_TRUE(cache.blob(hash));
    cache.keepOnly({}, own);
    EXPECT_LE(held(own), 5);
}

TEST(BlobCache, SeveralProcessesMayWriteOneValueAtOnce) {
    const Folder folder;
    {
        std::deque<BlobCache> caches;
        std::set<Hash> stored;
        for (int i = 0; i < 4; ++i) caches.emplace_back(folder.path, 0, 1'000'000'000);
        for (std::uint8_t i = 0; i < 50; ++i)
            for (BlobCache& cache : caches) {
                cache.cacheBlob(hashOf(bytes(i, 100'000)), bytes(i, 100'000));
                cache.keepBlob(hashOf(bytes(100 + i, 100'000)), bytes(100 + i, 100'000));
                stored.insert(hashOf(bytes(100 + i, 100'000)));
            }
        for (BlobCache& cache : caches) cache.keepOnly({}, stored);
    }
    BlobCache later(folder.path);
    for (std::uint8_t i = 0; i < 50; ++i) {
        EXPECT_TRUE(later.blob(hashOf(bytes(i, 100'000))));
        EXPECT_TRUE(later.blob(hashOf(bytes(100 + i, 100'000))));
    }
    EXPECT_EQ(std::distance(fs::directory_iterator(folder.path), {}), 100)
        << "nothing else is left";
}

TEST(BlobCache, FilesOfAKilledProcessAreRemoved) {
    const Folder folder;
    fs::create_directories(folder.path / "own-dead");
    std::ofstream(folder.path / "own-dead.lock");
    std::ofstream(folder.path / "own-dead" / "value") << "x";
    std::ofstream(folder.path / "other.part") << "x";
    fs::last_write_time(folder.path / "other.part",
                        fs::file_time_type::clock::now() - std::chrono::hours(2));
    const auto living = client::ProcessFolder::make(folder.path, "own-");
    ASSERT_TRUE(living);
    std::ofstream(living.path() / "value") << "x";
    BlobCache(folder.path, 0, 1'000'000);
    EXPECT_TRUE(fs::exists(living.path() / "value")) << "its process is running";
    EXPECT_EQ(std::distance(fs::directory_iterator(folder.path), {}), 2);
}

TEST(BlobCache, DoesNotTrustItsFiles) {
    const Folder folder;
    const auto blob = bytes(1);
    {
        BlobCache(folder.path).cacheBlob(hashOf(blob), blob);
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
