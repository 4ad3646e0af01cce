// Tests which big values a history names (B6), in each of the stores.

#include <gtest/gtest.h>

#include <algorithm>

#include "project/NamedBlobs.h"
#include "storage/MemoryCommitStore.h"
#include "storage/RocksCommitStore.h"
#include "unit/server/storage/TestCommits.h"

namespace usdlive::server {
namespace {

const LayerId kLayer{"a.usda"};
constexpr std::size_t kAll = ~std::size_t(0);

class InMemory {
public:
    std::unique_ptr<CommitStore> store = createMemoryCommitStore(createMemoryDisk());
};
class InRocks {
public:
    InRocks() {
        RocksCommitStoreOptions options;
        options.durability = Durability::OperatingSystem;
        options.minFreeBytes = 0;
        options.reserveBytes = 0;
        store = std::move(*createRocksCommitStore(folder.path, options));
    }
    test::TestFolder folder;
    std::unique_ptr<CommitStore> store;
};

template <class Where>
class NamedBlobsContract : public testing::Test {
public:
    NamedBlobsContract() {
        append(commits.next(kLayer, "/A", CreateSpec{SpecKind::Prim}));
        append(commits.next(kLayer, "/A.x", CreateSpec{SpecKind::Attribute}));
    }
    void append(const CommitRecord& record) { ASSERT_TRUE(where.store->append({&record, 1})); }
    void set(const std::string& field, FieldValue value) {
        append(commits.next(kLayer, "/A.x", SetField{field, {}, std::move(value)}));
    }

    Where where;
    test::TestCommits commits;
    NamedBlobs named;
};
using Stores = testing::Types<InMemory, InRocks>;
TYPED_TEST_SUITE(NamedBlobsContract, Stores);

Hash hashOf(unsigned number) { return sha256(asBytes(std::to_string(number))); }
Value big(unsigned number) {
    return Value::blob(arrayOf(ValueType::Float), hashOf(number), 300'000);
}

TYPED_TEST(NamedBlobsContract, B6FindsAllValuesThatCommitsName) {
    this->set("default", big(1));
    TimeSamples samples;
    samples.samples = {{1.0, big(2)}, {2.0, big(3)}};
    this->set("timeSamples", samples);
    this->set("default", doubleValue(4));  // only the history still names the first value
    LayerDoc file;
    ASSERT_TRUE(file.apply("/B", CreateSpec{SpecKind::Prim}));
    ASSERT_TRUE(file.apply("/B.y", CreateSpec{SpecKind::Attribute}));
    ASSERT_TRUE(file.apply("/B.y", SetField{"default", {}, big(5)}));
    this->append(this->commits.import({"b.usda"}, file));
    ASSERT_EQ(*this->named.read(*this->where.store, kAll), true);
    EXPECT_EQ(this->named.upTo(), this->where.store->head().revision);
    for (const unsigned number : {1u, 2u, 3u, 5u})
        EXPECT_TRUE(this->named.contains(hashOf(number)));
    EXPECT_FALSE(this->named.contains(hashOf(4)));
}

TYPED_TEST(NamedBlobsContract, B6ReadsInStepsAndContinues) {
    for (unsigned number = 0; number < 20; ++number) this->set("default", big(number));
    std::size_t steps = 1;
    while (!*this->named.read(*this->where.store, 500)) ++steps;
    EXPECT_GT(steps, 4u);
    EXPECT_FALSE(this->named.contains(hashOf(20)));
    this->set("default", big(20));
    EXPECT_EQ(*this->named.read(*this->where.store, kAll), true);
    for (unsigned number = 0; number <= 20; ++number)
        EXPECT_TRUE(this->named.contains(hashOf(number)));
}

// A value is no longer named after the base replaced all commits that named it.
TYPED_TEST(NamedBlobsContract, B6FollowsTheBaseOfTheHistory) {
    const auto always = [] { return true; };
    const auto readAll = [&](NamedBlobs& named) {
        while (!*named.read(*this->where.store, 500)) {
        }
    };
    this->set("default", big(1));
    this->set("default", big(2));
    this->set("custom", doubleValue(1));
    const Revision base = this->commits.head.revision;
    this->set("default", big(3));
    this->set("default", big(4));
    readAll(this->named);
    for (const unsigned number : {1u, 2u, 3u, 4u})
        EXPECT_TRUE(this->named.contains(hashOf(number)));

    const auto expect = [&](std::vector<unsigned> named, unsigned most) {
        NamedBlobs fresh;
        readAll(fresh);
        readAll(this->named);
        for (unsigned number = 1; number <= most; ++number) {
            const bool is = std::ranges::count(named, number) > 0;
            EXPECT_EQ(this->named.contains(hashOf(number)), is) << number;
            EXPECT_EQ(fresh.contains(hashOf(number)), is) << number;
        }
    };
    ASSERT_TRUE(this->where.store->compact(base, always));
    expect({2, 3, 4}, 4);  // the layer held the second value at the base
    this->set("default", big(5));
    this->set("custom", doubleValue(2));
    ASSERT_TRUE(this->where.store->compact(this->commits.head.revision, always));
    expect({5}, 5);
    this->set("default", big(6));
    expect({5, 6}, 6);
}

TYPED_TEST(NamedBlobsContract, B6AnotherHistoryIsReadFromTheStart) {
    this->set("default", big(1));
    EXPECT_EQ(*this->named.read(*this->where.store, kAll), true);
    TypeParam other;
    test::TestCommits commits;
    const auto append = [&](const CommitRecord& one) {
        ASSERT_TRUE(other.store->append({&one, 1}));
    };
    append(commits.next(kLayer, "/B", CreateSpec{SpecKind::Prim}));
    append(commits.next(kLayer, "/B.x", CreateSpec{SpecKind::Attribute}));
    append(commits.next(kLayer, "/B.x", SetField{"default", {}, big(2)}));
    EXPECT_EQ(*this->named.read(*other.store, kAll), true);
    EXPECT_FALSE(this->named.contains(hashOf(1)));
    EXPECT_TRUE(this->named.contains(hashOf(2)));
}

}  // namespace
}  // namespace usdlive::server
