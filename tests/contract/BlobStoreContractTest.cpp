// Tests all stores of big values with one suite: in memory and as files.

#include <gtest/gtest.h>

#include <fstream>
#include <random>
#include <set>

#include "storage/BlobStore.h"
#include "unit/server/storage/TestCommits.h"

namespace usdlive::server {
namespace {

constexpr std::uint64_t kMaxBytes = 1'000'000;

BlobStoreOptions options() {
    BlobStoreOptions options;
    options.maxBytes = kMaxBytes;
    options.minFreeBytes = 0;
    options.maxUnfinished = 4;
    return options;
}

class InMemory {
public:
    std::unique_ptr<BlobStore> store = createMemoryBlobStore(options());
};
class InFiles {
public:
    test::TestFolder folder;
    std::unique_ptr<BlobStore> store = std::move(*createFileBlobStore(folder.path, options()));
};

template <class Where>
class BlobStoreContract : public testing::Test {
public:
    Where where;
    BlobStore& blobs = *where.store;
};
using Disks = testing::Types<InMemory, InFiles>;
TYPED_TEST_SUITE(BlobStoreContract, Disks);

Bytes someBytes(std::size_t size, unsigned seed = 1) {
    std::mt19937 random(seed);
    Bytes bytes(size);
    for (auto& byte : bytes) byte = std::uint8_t(random());
    return bytes;
}
ErrorCode codeOf(const auto& result) { return result ? ErrorCode{} : result.error().code; }

TYPED_TEST(BlobStoreContract, KeepsAValueOfSeveralChunks) {
    const Bytes value = someBytes(600'000);
    const Hash hash = sha256(value);
    EXPECT_FALSE(this->blobs.has(hash));
    EXPECT_EQ(codeOf(this->blobs.size(hash)), ErrorCode::BlobNotFound);
    EXPECT_EQ(codeOf(this->blobs.read(hash, 0, 1)), ErrorCode::BlobNotFound);
    for (std::size_t at = 0; at < value.size(); at += 200'000) {
        EXPECT_FALSE(this->blobs.has(hash));
        EXPECT_EQ(this->blobs.write(hash, value.size(), at, ByteView(value).subspan(at, 200'000)),
                  at + 200'000 == value.size());
    }
    EXPECT_TRUE(this->blobs.has(hash));
    EXPECT_EQ(this->blobs.size(hash), value.size());
    EXPECT_EQ(this->blobs.read(hash, 0, value.size()), value);
    EXPECT_EQ(this->blobs.read(hash, 599'999, 100), Bytes{value.back()});
    EXPECT_EQ(this->blobs.read(hash, 600'000, 100), Bytes());
    EXPECT_EQ(this->blobs.read(hash, ~std::uint64_t(0), ~std::size_t(0)), Bytes());
    EXPECT_EQ(this->blobs.write(hash, value.size(), 200'000, {}), true)
        << "the value is stored already";
}

TYPED_TEST(BlobStoreContract, StartsAgainAtTheFirstChunk) {
    const Bytes value = someBytes(1'000);
    const Hash hash = sha256(value);
    EXPECT_EQ(this->blobs.write(hash, 1'000, 0, ByteView(value).first(700)), false);
    EXPECT_EQ(this->blobs.write(hash, 1'000, 0, ByteView(value).first(400)), false);
    EXPECT_EQ(this->blobs.write(hash, 1'000, 400, ByteView(value).subspan(400)), true);
    EXPECT_EQ(this->blobs.read(hash, 0, 2'000), value);
}

TYPED_TEST(BlobStoreContract, B1UploadsOfOneValueAreIndependent) {
    const Bytes value = someBytes(1'000);
    const Hash hash = sha256(value);
    const ByteView all(value);
    EXPECT_EQ(this->blobs.write(hash, 1'000, 0, all.first(600), 1), false);
    EXPECT_EQ(this->blobs.write(hash, 1'000, 0, all.first(300), 2), false);
    EXPECT_EQ(codeOf(this->blobs.write(hash, 1'000, 0, Bytes(1'000), 3)), ErrorCode::BlobMismatch);
    EXPECT_EQ(this->blobs.write(hash, 1'000, 300, all.subspan(300, 300), 2), false);
    EXPECT_EQ(this->blobs.write(hash, 1'000, 600, all.subspan(600), 1), true);
    EXPECT_EQ(this->blobs.write(hash, 1'000, 600, all.subspan(600), 2), true)
        << "the value is stored already";
    EXPECT_EQ(this->blobs.read(hash, 0, 2'000), value);
}

TYPED_TEST(BlobStoreContract, RefusesBytesWithAnotherHash) {
    const Bytes value = someBytes(1'000), other = someBytes(1'000, 2);
    const Hash hash = sha256(value);
    EXPECT_EQ(codeOf(this->blobs.write(hash, 1'000, 0, other)), ErrorCode::BlobMismatch);
    EXPECT_EQ(codeOf(this->blobs.write(hash, 999, 0, value)), ErrorCode::BlobMismatch);
    EXPECT_EQ(codeOf(this->blobs.write(hash, 1'000, 500, value)), ErrorCode::BlobMismatch);
    EXPECT_EQ(this->blobs.write(hash, 1'000, 0, ByteView(value).first(500)), false);
    EXPECT_EQ(codeOf(this->blobs.write(hash, 1'000, 600, ByteView(value).subspan(600))),
              ErrorCode::BlobMismatch);
    EXPECT_EQ(codeOf(this->blobs.write(hash, 1'000, 500, ByteView(value).subspan(500))),
              ErrorCode::BlobMismatch)
        << "the earlier chunks were dropped";
    EXPECT_FALSE(this->blobs.has(hash));
    EXPECT_EQ(this->blobs.write(hash, 1'000, 0, value), true);
}

TYPED_TEST(BlobStoreContract, RefusesTooLargeValues) {
    const Bytes value = someBytes(10);
    EXPECT_EQ(codeOf(this->blobs.write(sha256(value), kMaxBytes + 1, 0, value)),
              ErrorCode::BlobTooLarge);
}

TYPED_TEST(BlobStoreContract, B6ADroppedValueIsAbsentUntilItIsWrittenAgain) {
    std::vector<Hash> hashes;
    for (unsigned seed = 0; seed < 5; ++seed) {
        const Bytes value = someBytes(1'000, seed);
        hashes.push_back(sha256(value));
        ASSERT_TRUE(this->blobs.write(hashes.back(), 1'000, 0, value).value());
    }
    auto listed = *this->blobs.list();
    EXPECT_EQ(std::set<Hash>(listed.begin(), listed.end()),
              std::set<Hash>(hashes.begin(), hashes.end()));

    this->blobs.drop(std::span(hashes).first(4));
    for (std::size_t index = 0; index < 4; ++index) {
        EXPECT_FALSE(this->blobs.has(hashes[index]));
        EXPECT_EQ(codeOf(this->blobs.read(hashes[index], 0, 1)), ErrorCode::BlobNotFound);
    }
    EXPECT_EQ(*this->blobs.list(), std::vector<Hash>{hashes[4]});
    // One value is written again before its bytes are removed, and stays.
    EXPECT_EQ(this->blobs.write(hashes[1], 1'000, 0, someBytes(1'000, 1)), true);
    EXPECT_TRUE(this->blobs.has(hashes[1]));
    std::size_t removed = 0;
    for (;;) {
        const auto purged = this->blobs.purge(2);
        ASSERT_TRUE(purged);
        EXPECT_EQ(purged->bytes, purged->values * 1'000);
        removed += purged->values;
        if (purged->values < 2) break;
    }
    EXPECT_GE(removed, 3u);
    EXPECT_EQ(this->blobs.read(hashes[1], 0, 1'000), someBytes(1'000, 1));
    listed = *this->blobs.list();
    EXPECT_EQ(std::set<Hash>(listed.begin(), listed.end()), (std::set<Hash>{hashes[1], hashes[4]}));
    // The other is written again after its bytes were removed.
    EXPECT_EQ(this->blobs.write(hashes[0], 1'000, 0, someBytes(1'000, 0)), true);
    EXPECT_EQ(this->blobs.read(hashes[0], 0, 1'000), someBytes(1'000, 0));
}

TYPED_TEST(BlobStoreContract, TL2AnUploadContinuesWhereItsWriterLeft) {
    const Bytes value = someBytes(1'000);
    const Hash hash = sha256(value);
    const ByteView all(value);
    EXPECT_EQ(this->blobs.write(hash, 1'000, 0, all.first(600), 1), false);
    EXPECT_EQ(codeOf(this->blobs.write(hash, 1'000, 600, all.subspan(600), 2)),
              ErrorCode::BlobMismatch)
        << "its writer is still there";
    this->blobs.forget(1);
    EXPECT_EQ(codeOf(this->blobs.write(hash, 1'000, 601, all.subspan(601), 2)),
              ErrorCode::BlobMismatch)
        << "a gap";
    EXPECT_EQ(this->blobs.write(hash, 1'000, 0, all.first(600), 3), false);
    this->blobs.forget(3);
    // A client sends again what perhaps did not arrive.
    EXPECT_EQ(this->blobs.write(hash, 1'000, 400, all.subspan(400, 100), 4), false);
    EXPECT_EQ(this->blobs.write(hash, 1'000, 500, all.subspan(500, 200), 4), false);
    EXPECT_EQ(this->blobs.write(hash, 1'000, 700, all.subspan(700), 4), true);
    EXPECT_EQ(this->blobs.read(hash, 0, 2'000), value);
}

TYPED_TEST(BlobStoreContract, TL2WrongBytesOfAnotherWriterSpoilNothing) {
    const Bytes value = someBytes(1'000), wrong = someBytes(600, 2);
    const Hash hash = sha256(value);
    const ByteView all(value);
    EXPECT_EQ(this->blobs.write(hash, 1'000, 0, wrong, 1), false);
    this->blobs.forget(1);
    EXPECT_EQ(codeOf(this->blobs.write(hash, 1'000, 600, all.subspan(600), 2)),
              ErrorCode::BlobMismatch);
    EXPECT_EQ(this->blobs.write(hash, 1'000, 0, wrong, 1), false);
    this->blobs.forget(1);
    EXPECT_EQ(this->blobs.write(hash, 1'000, 0, all.first(600), 2), false) << "begins anew";
    EXPECT_EQ(this->blobs.write(hash, 1'000, 600, all.subspan(600), 2), true);
}

TYPED_TEST(BlobStoreContract, TakesAnEmptyValue) {
    EXPECT_EQ(this->blobs.write(sha256(Bytes()), 0, 0, {}), true);
    EXPECT_EQ(this->blobs.size(sha256(Bytes())), 0u);
}

TEST(FileBlobStore, KeepsValuesAndRemovesUnfinishedUploads) {
    test::TestFolder folder;
    const Bytes value = someBytes(1'000), other = someBytes(1'000, 2);
    {
        const auto store = createFileBlobStore(folder.path, options());
        ASSERT_TRUE((*store)->write(sha256(value), 1'000, 0, value).value());
        ASSERT_FALSE((*store)->write(sha256(other), 1'000, 0, ByteView(other).first(9)).value());
    }
    std::ofstream(folder.path / "unfinished" / "of-a-process-that-was-killed") << "x";
    const auto store = createFileBlobStore(folder.path, options());
    EXPECT_EQ((*store)->read(sha256(value), 0, 1'000), value);
    EXPECT_TRUE(std::filesystem::is_empty(folder.path / "unfinished"));
    const std::string hex = sha256(value).hex();
    EXPECT_TRUE(std::filesystem::exists(folder.path / hex.substr(0, 2) / hex));
}

// The process is killed between drop() and the removal: nothing is lost and nothing is left behind.
TEST(FileBlobStore, B6ADroppedValueThatWasNotRemovedIsBackAfterARestart) {
    test::TestFolder folder;
    const Bytes value = someBytes(1'000), other = someBytes(1'000, 2);
    const std::vector<Hash> both{sha256(value), sha256(other)};
    {
        const auto store = createFileBlobStore(folder.path, options());
        ASSERT_TRUE((*store)->write(both[0], 1'000, 0, value).value());
        ASSERT_TRUE((*store)->write(both[1], 1'000, 0, other).value());
        (*store)->drop(both);
        EXPECT_EQ((*store)->purge(1)->values, 1u);
    }
    const auto store = createFileBlobStore(folder.path, options());
    EXPECT_EQ((*store)->has(both[0]) + (*store)->has(both[1]), 1);
    std::size_t files = 0;
    for (const auto& entry : std::filesystem::recursive_directory_iterator(folder.path))
        files += entry.is_regular_file() ? 1 : 0;
    EXPECT_EQ(files, 1u);
}

TEST(FileBlobStore, BoundsUnfinishedUploads) {
    test::TestFolder folder;
    const auto store = createFileBlobStore(folder.path, options());
    for (unsigned seed = 0; seed < 10; ++seed) {
        const Bytes value = someBytes(10, seed);
        EXPECT_EQ((*store)->write(sha256(value), 10, 0, ByteView(value).first(5)), false);
    }
    const auto files = std::filesystem::directory_iterator(folder.path / "unfinished");
    EXPECT_EQ(std::distance(begin(files), end(files)), 4);
    const Bytes last = someBytes(10, 9);
    EXPECT_EQ((*store)->write(sha256(last), 10, 5, ByteView(last).subspan(5)), true);
}

// The store keeps four incomplete values.
TEST(FileBlobStore, SE22TheWriterWithTheMostIncompleteValuesGivesWay) {
    test::TestFolder folder;
    const auto store = createFileBlobStore(folder.path, options());
    const Bytes mine = someBytes(10, 50);
    EXPECT_EQ((*store)->write(sha256(mine), 10, 0, ByteView(mine).first(5), 1), false);
    for (unsigned seed = 0; seed < 10; ++seed) {
        const Bytes value = someBytes(10, seed);
        EXPECT_EQ((*store)->write(sha256(value), 10, 0, ByteView(value).first(5), 2), false);
    }
    EXPECT_EQ((*store)->write(sha256(mine), 10, 5, ByteView(mine).subspan(5), 1), true);
    const Bytes last = someBytes(10, 9), first = someBytes(10, 0);
    EXPECT_EQ((*store)->write(sha256(last), 10, 5, ByteView(last).subspan(5), 2), true);
    EXPECT_FALSE((*store)->write(sha256(first), 10, 5, ByteView(first).subspan(5), 2));
}

TEST(FileBlobStore, SE22ManySessionsOfAUserPushOutItsOwnValues) {
    test::TestFolder folder;
    const auto store = createFileBlobStore(folder.path, options());
    const auto begin = [&](unsigned seed, const BlobWriter& writer) {
        const Bytes value = someBytes(10, seed);
        EXPECT_EQ((*store)->write(sha256(value), 10, 0, ByteView(value).first(5), writer), false);
    };
    begin(50, {1, "user ann"});
    begin(51, {1, "user ann"});
    for (unsigned seed = 0; seed < 10; ++seed) begin(seed, {100 + seed, "user eve"});
    for (const unsigned seed : {50, 51}) {
        const Bytes mine = someBytes(10, seed);
        EXPECT_EQ((*store)->write(sha256(mine), 10, 5, ByteView(mine).subspan(5), {1, "user ann"}),
                  true)
            << "ann's session has the most values, but eve's have more";
    }
}

std::ptrdiff_t unfinishedFiles(const test::TestFolder& folder) {
    const auto files = std::filesystem::directory_iterator(folder.path / "unfinished");
    return std::distance(begin(files), end(files));
}

// Begins values of 500 bytes, whose writers leave.
void beginAndLeave(BlobStore& store, unsigned count) {
    for (unsigned seed = 0; seed < count; ++seed) {
        const Bytes value = someBytes(1'000, seed);
        EXPECT_EQ(store.write(sha256(value), 1'000, 0, ByteView(value).first(500), seed), false);
        store.forget(seed);
    }
}

TEST(FileBlobStore, TL2BoundsWhatIsKeptOfWritersThatHaveLeft) {
    test::TestFolder folder;
    BlobStoreOptions bounded = options();
    bounded.maxLeftBytes = 1'200;
    const auto store = createFileBlobStore(folder.path, bounded);
    beginAndLeave(**store, 4);
    EXPECT_EQ(unfinishedFiles(folder), 2);
    const Bytes last = someBytes(1'000, 3);
    EXPECT_EQ((*store)->write(sha256(last), 1'000, 500, ByteView(last).subspan(500), 9), true);
}

TEST(FileBlobStore, TL2NothingIsKeptForLong) {
    test::TestFolder folder;
    BlobStoreOptions shortly = options();
    shortly.keepLeft = std::chrono::milliseconds(0);
    const auto store = createFileBlobStore(folder.path, shortly);
    beginAndLeave(**store, 3);
    EXPECT_EQ(unfinishedFiles(folder), 0);
}

// The store keeps four incomplete values.
TEST(FileBlobStore, TL2ActiveUploadsGoBeforeThoseThatWereLeft) {
    test::TestFolder folder;
    const auto store = createFileBlobStore(folder.path, options());
    const Bytes active = someBytes(1'000, 50);
    EXPECT_EQ((*store)->write(sha256(active), 1'000, 0, ByteView(active).first(1), 50), false);
    beginAndLeave(**store, 10);
    EXPECT_EQ(unfinishedFiles(folder), 4);
    EXPECT_EQ((*store)->write(sha256(active), 1'000, 1, ByteView(active).subspan(1), 50), true);
}

TEST(FileBlobStore, TL2AlmostFullDiskKeepsNothing) {
    test::TestFolder folder;
    BlobStoreOptions full = options();
    full.minFreeBytes = std::filesystem::space(folder.path).available * 3 / 4;
    const auto store = createFileBlobStore(folder.path, full);
    beginAndLeave(**store, 3);
    EXPECT_EQ(unfinishedFiles(folder), 0);
}

TEST(FileBlobStore, RefusesWhenTheDiskIsFull) {
    test::TestFolder folder;
    BlobStoreOptions full = options();
    full.minFreeBytes = std::uint64_t(1) << 60;
    const auto store = createFileBlobStore(folder.path, full);
    const Bytes value = someBytes(10);
    EXPECT_EQ(codeOf((*store)->write(sha256(value), 10, 0, value)), ErrorCode::StorageFull);
}

}  // namespace
}  // namespace usdlive::server
