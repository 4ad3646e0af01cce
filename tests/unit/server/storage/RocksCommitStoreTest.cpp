// Tests the store over RocksDB: damage, crashes, full disks and bases.
#include "storage/RocksCommitStore.h"

#include <gtest/gtest.h>
#include <rocksdb/db.h>
#include <signal.h>
#include <sys/resource.h>
#include <unistd.h>

#include <atomic>
#include <fstream>
#include <map>
#include <random>
#include <thread>

#include "TestCommits.h"
#include "unit/Seeds.h"
#include "unit/SmallDisk.h"

namespace usdlive::server {
namespace {

namespace fs = std::filesystem;
using test::RandomEdits;
using test::TestCommits;
using test::TestFolder;
using usdlive::test::SmallDisk;

const LayerId kStoredLayer{"a.usda"};
constexpr std::uint64_t kMib = 1024 * 1024;

RocksCommitStoreOptions storeOptions() {
    RocksCommitStoreOptions options;
    options.minFreeBytes = 0;
    options.reserveBytes = 0;
    return options;
}

std::unique_ptr<CommitStore> open(const fs::path& folder) {
    auto store = createRocksCommitStore(folder, storeOptions());
    if (!store) throw std::runtime_error(store.error().message);
    return std::move(*store);
}

std::vector<CommitRecord> someCommits(TestCommits& commits, int count, unsigned seed = 1) {
    RandomEdits random(seed);
    std::vector<CommitRecord> all;
    for (int number = 0; number < count; ++number)
        all.push_back(commits.next(random.next(kStoredLayer, commits.layers[kStoredLayer])));
    return all;
}

void append(CommitStore& store, std::span<const CommitRecord> commits) {
    for (const CommitRecord& commit : commits) {
        const auto appended = store.append({&commit, 1});
        ASSERT_TRUE(appended) << appended.error().message;
    }
}

bool always() { return true; }

bool keep(CommitStore& store, const TestCommits& commits) {
    return bool(store.keepSnapshot(kStoredLayer, commits.layers.at(kStoredLayer),
                                   commits.head.revision, commits.head.hash));
}

/// Copies the store's folder in the state that a killed process or a fault leaves.
void copyFolder(const fs::path& from, const fs::path& to) {
    fs::remove_all(to);
    fs::copy(from, to, fs::copy_options::recursive);
}

// An open store can remove a file at any time.
std::vector<fs::path> filesOf(const fs::path& folder, const std::string& extension = "") {
    std::vector<fs::path> files;
    std::error_code removed;
    for (const auto& entry : fs::recursive_directory_iterator(folder)) {
        if (!extension.empty() && entry.path().extension() != extension) continue;
        const bool isFile = entry.is_regular_file(removed);
        const auto size = isFile ? entry.file_size(removed) : 0;
        if (!removed && size > 0) files.push_back(entry.path());
        removed.clear();
    }
    std::sort(files.begin(), files.end());
    return files;
}

fs::path newestLog(const fs::path& folder) { return filesOf(folder, ".log").back(); }

/// Opens a damaged copy. It must either be complete or report the damage.
testing::AssertionResult openIsEqualOrCorrupt(const fs::path& folder, const TestCommits& commits) {
    const auto store = createRocksCommitStore(folder, storeOptions());
    const auto corrupt = [](const Error& error) {
        return error.code == ErrorCode::StorageCorrupt
                   ? testing::AssertionSuccess()
                   : testing::AssertionFailure() << errorName(error.code) << error.message;
    };
    if (!store) return corrupt(store.error());
    const auto head = (*store)->head();
    if (head.revision != commits.head.revision || head.hash != commits.head.hash)
        return testing::AssertionFailure() << "the history ends at " << head.revision;
    Revision visited = 0;
    const auto read = (*store)->read(0, head.revision, [&](const StoredCommit&) {
        ++visited;
        return true;
    });
    if (!read) return corrupt(read.error());
    if (visited != head.revision - (*store)->base().revision)
        return testing::AssertionFailure() << visited << " commits";
    const auto doc = (*store)->loadLayer(kStoredLayer);
    if (!doc) return corrupt(doc.error());
    if (!*doc || (*doc)->dump() != commits.layers.at(kStoredLayer).dump())
        return testing::AssertionFailure() << "the layer differs";
    return testing::AssertionSuccess();
}

TEST(RocksCommitStore, FilesOfAKilledProcessAreComplete) {
    TestFolder folder;
    TestCommits commits;
    const auto store = open(folder.path / "a");
    for (int round = 0; round < 5; ++round) {
        append(*store, someCommits(commits, 20, unsigned(round)));
        if (round % 2 == 0) {
            ASSERT_TRUE(keep(*store, commits));
        }
        append(*store, someCommits(commits, 5, unsigned(round)));
        copyFolder(folder.path / "a", folder.path / "b");
        ASSERT_TRUE(openIsEqualOrCorrupt(folder.path / "b", commits));
        EXPECT_EQ(open(folder.path / "b")->head().revision, commits.head.revision);
    }
}

TEST(RocksCommitStore, ATornAppendHasNoEffect) {
    TestFolder folder;
    TestCommits commits;
    const fs::path whole = folder.path / "a", torn = folder.path / "b";
    const auto store = open(whole);
    append(*store, someCommits(commits, 20));
    copyFolder(whole, torn);
    const auto before = fs::file_size(newestLog(torn));
    const TestCommits acknowledged = commits;
    append(*store, someCommits(commits, 1));
    const auto log = newestLog(whole);
    const auto after = fs::file_size(log);
    ASSERT_GT(after, before);
    for (auto cut = before + 1; cut < after; cut += 1 + (after - before) / 20) {
        SCOPED_TRACE(cut);
        TestFolder copy;
        copyFolder(torn, copy.path / "b");
        fs::copy_file(log, newestLog(copy.path / "b"), fs::copy_options::overwrite_existing);
        fs::resize_file(newestLog(copy.path / "b"), cut);
        const auto opened = createRocksCommitStore(copy.path / "b", storeOptions());
        ASSERT_TRUE(opened) << opened.error().message;
        EXPECT_EQ((*opened)->head().revision, acknowledged.head.revision);
        EXPECT_EQ((*opened)->loadLayer(kStoredLayer).value()->dump(),
                  acknowledged.layers.at(kStoredLayer).dump());
    }
}

TEST(RocksCommitStore, NeverServesAShortenedHistory) {
    TestFolder folder;
    TestCommits commits;
    const auto store = open(folder.path / "a");
    append(*store, someCommits(commits, 30));
    const auto size = fs::file_size(newestLog(folder.path / "a"));
    for (const std::uint64_t cut : {1, 10, 100, 1'000}) {
        copyFolder(folder.path / "a", folder.path / "b");
        fs::resize_file(newestLog(folder.path / "b"), size - cut);
        const auto opened = createRocksCommitStore(folder.path / "b", storeOptions());
        ASSERT_FALSE(opened) << cut;
        EXPECT_EQ(opened.error().code, ErrorCode::StorageCorrupt);
        EXPECT_NE(opened.error().message.find("commit 30"), std::string::npos)
            << opened.error().message;
    }
}

// The damage is in a log, in tables, in the files that list them, and in our own files.
TEST(RocksCommitStore, AFlippedBitIsFoundOrHarmless) {
    TestFolder folder;
    TestCommits commits;
    const fs::path whole = folder.path / "a", damaged = folder.path / "b";
    for (unsigned part = 0; part < 3; ++part) {  // each opening writes the log to tables
        const auto store = open(whole);
        append(*store, someCommits(commits, 30, part));
        ASSERT_TRUE(keep(*store, commits));
    }
    const auto store = open(whole);
    append(*store, someCommits(commits, 30, 3));

    std::mt19937 random(7);
    for (unsigned flip = 0; flip < seedsOf(150); ++flip) {
        copyFolder(whole, damaged);
        const auto files = filesOf(damaged);
        const fs::path& path = files[random() % files.size()];
        std::fstream file(path, std::ios::in | std::ios::out | std::ios::binary);
        const auto at = std::streamoff(random() % fs::file_size(path));
        const int bit = 1 << random() % 8;
        const int byte = file.seekg(at).get();
        file.seekp(at).put(char(byte ^ bit));
        file.close();
        ASSERT_TRUE(openIsEqualOrCorrupt(damaged, commits))
            << path << " at " << at << ", bit " << bit;
    }
}

TEST(RocksCommitStore, AMissingFileIsFound) {
    TestFolder folder;
    TestCommits commits;
    const fs::path whole = folder.path / "a", damaged = folder.path / "b";
    for (unsigned part = 0; part < 3; ++part) {
        const auto store = open(whole);
        append(*store, someCommits(commits, 30, part));
        ASSERT_TRUE(keep(*store, commits));
    }
    auto store = open(whole);
    append(*store, someCommits(commits, 30, 3));
    for (const bool hasBase : {false, true}) {
        if (hasBase) {
            store.reset();
            store = open(whole);
            ASSERT_TRUE(store->compact(100, always));
        }
        for (std::size_t at = 0; at < filesOf(whole).size(); ++at) {
            copyFolder(whole, damaged);
            const auto path = filesOf(damaged)[at];
            fs::remove(path);
            ASSERT_TRUE(openIsEqualOrCorrupt(damaged, commits)) << path;
        }
    }
}

void writeFormat(const fs::path& folder, std::uint8_t number) {
    Bytes format{number, 0, 0, 0};
    const Hash checksum = sha256({format});
    format.insert(format.end(), checksum.bytes.begin(), checksum.bytes.end());
    std::ofstream(folder / "format", std::ios::binary)
        .write(reinterpret_cast<const char*>(format.data()), std::streamsize(format.size()));
}

/// The raw records of a store that is not open.
class RawRecords {
public:
    explicit RawRecords(const fs::path& folder) {
        std::vector<rocksdb::ColumnFamilyDescriptor> families;
        for (const char* name : {"default", "commits", "clients"})
            families.emplace_back(name, rocksdb::ColumnFamilyOptions());
        rocksdb::DBOptions options;
        rocksdb::DB* opened = nullptr;
        const auto status =
            rocksdb::DB::Open(options, (folder / "db").string(), families, &handles_, &opened);
        if (!status.ok()) throw std::runtime_error(status.ToString());
        db_.reset(opened);
    }
    ~RawRecords() {
        for (auto* handle : handles_) db_->DestroyColumnFamilyHandle(handle);
    }
    enum Family { Meta, Commits, Clients };
    std::vector<std::string> keys(Family family) const {
        std::vector<std::string> all;
        const std::unique_ptr<rocksdb::Iterator> at(db_->NewIterator({}, handles_[family]));
        for (at->SeekToFirst(); at->Valid(); at->Next()) all.push_back(at->key().ToString());
        return all;
    }
    std::string get(Family family, const std::string& key) const {
        std::string value;
        EXPECT_TRUE(db_->Get({}, handles_[family], key, &value).ok());
        return value;
    }
    void put(Family family, const std::string& key, const std::string& value) {
        ASSERT_TRUE(db_->Put({}, handles_[family], key, value).ok());
    }
    void erase(Family family, const std::string& key) {
        ASSERT_TRUE(db_->Delete({}, handles_[family], key).ok());
    }

private:
    std::unique_ptr<rocksdb::DB> db_;
    std::vector<rocksdb::ColumnFamilyHandle*> handles_;
};

TEST(RocksCommitStore, ASnapshotThatCannotBeReadIsReplacedByTheLog) {
    TestFolder folder;
    TestCommits commits;
    const fs::path kept = folder.path / "snapshots" / "1", other = folder.path / "other";
    const auto check = [&](auto damage) {
        const auto store = open(folder.path);
        append(*store, someCommits(commits, 30));
        ASSERT_TRUE(keep(*store, commits));
        append(*store, someCommits(commits, 3));
        damage();
        EXPECT_EQ(store->loadLayer(kStoredLayer).value()->dump(),
                  commits.layers[kStoredLayer].dump());
    };
    check([&] { fs::copy_file(kept, other); });
    check([&] { fs::remove(kept); });
    check([&] { fs::resize_file(kept, 0); });
    check([&] { fs::resize_file(kept, fs::file_size(kept) / 2); });
    check([&] { fs::copy_file(other, kept, fs::copy_options::overwrite_existing); });
}

// Somebody restored an older copy of the database.
TEST(RocksCommitStore, ASnapshotOfAnotherHistoryIsNotUsed) {
    TestFolder folder;
    TestCommits commits;
    {
        const auto store = open(folder.path / "a");
        append(*store, someCommits(commits, 10));
    }
    copyFolder(folder.path / "a", folder.path / "b");
    {
        TestCommits others = commits;
        const auto store = open(folder.path / "b");
        append(*store, someCommits(others, 10, 2));
        ASSERT_TRUE(keep(*store, others));
    }
    fs::copy(folder.path / "b" / "snapshots", folder.path / "a" / "snapshots",
             fs::copy_options::recursive);
    const auto store = open(folder.path / "a");
    EXPECT_EQ(store->loadLayer(kStoredLayer).value()->dump(), commits.layers[kStoredLayer].dump())
        << "ahead";
    append(*store, someCommits(commits, 10, 3));
    EXPECT_EQ(store->loadLayer(kStoredLayer).value()->dump(), commits.layers[kStoredLayer].dump());
}

TEST(RocksCommitStore, ABaseThatIsDamagedIsFound) {
    TestFolder folder;
    TestCommits commits;
    {
        const auto store = open(folder.path);
        append(*store, someCommits(commits, 30));
        ASSERT_TRUE(store->compact(20, always));
    }
    const fs::path base = folder.path / "base" / "1-20", other = folder.path / "other";
    fs::copy_file(base, other);
    const auto expectDamaged = [&] {
        const auto loaded = open(folder.path)->loadLayer(kStoredLayer);
        ASSERT_FALSE(loaded);
        EXPECT_EQ(loaded.error().code, ErrorCode::StorageCorrupt);
        EXPECT_NE(loaded.error().message.find(base.string()), std::string::npos)
            << loaded.error().message;
        fs::copy_file(other, base, fs::copy_options::overwrite_existing);
    };
    fs::remove(base);
    expectDamaged();
    fs::resize_file(base, fs::file_size(base) / 2);
    expectDamaged();
    {  // a complete snapshot of another history
        TestFolder elsewhere;
        TestCommits others;
        const auto store = open(elsewhere.path);
        append(*store, someCommits(others, 30, 2));
        ASSERT_TRUE(store->compact(20, always));
        fs::copy_file(elsewhere.path / "base" / "1-20", base, fs::copy_options::overwrite_existing);
    }
    expectDamaged();
    EXPECT_EQ(open(folder.path)->loadLayer(kStoredLayer).value()->dump(),
              commits.layers[kStoredLayer].dump());
}

// Simulates a crash of the machine: the mark is not synced.
TEST(RocksCommitStore, AMarkThatIsOlderThanTheBaseDoesNoHarm) {
    TestFolder folder;
    TestCommits commits;
    const fs::path mark = folder.path / "head", old = folder.path / "old-head";
    {
        const auto store = open(folder.path);
        append(*store, someCommits(commits, 10));
        fs::copy_file(mark, old);
        append(*store, someCommits(commits, 20));
        ASSERT_TRUE(store->compact(20, always));
    }
    fs::copy_file(old, mark, fs::copy_options::overwrite_existing);
    EXPECT_EQ(open(folder.path)->loadLayer(kStoredLayer).value()->dump(),
              commits.layers[kStoredLayer].dump());
}

TEST(RocksCommitStore, CommitsThatABaseReplacedAreRemoved) {
    TestFolder folder;
    TestCommits commits;
    const LayerId other{"b.usda"};
    auto store = open(folder.path);
    append(*store, std::vector{commits.next(other, "/A", CreateSpec{SpecKind::Prim})});
    append(*store, someCommits(commits, 2'000));
    ASSERT_TRUE(keep(*store, commits));
    const auto before = store->space();
    ASSERT_TRUE(store->compact(1'000, always));
    EXPECT_TRUE(fs::exists(folder.path / "snapshots" / "2")) << "it is newer";
    ASSERT_TRUE(store->compact(2'001, always));
    EXPECT_FALSE(fs::exists(folder.path / "base" / "2-1000")) << "a newer base replaced it";
    EXPECT_TRUE(fs::exists(folder.path / "base" / "1-1000")) << "the other layer is unchanged";
    append(*store, someCommits(commits, 1'000, 2));
    ASSERT_TRUE(store->compact(3'000, always));
    EXPECT_FALSE(fs::exists(folder.path / "snapshots" / "2"))
        << "the snapshot is older than the base";
    const auto after = store->space();
    EXPECT_LT(after->log, before->log / 2);
    ASSERT_EQ(after->layers.size(), 2u);
    EXPECT_GT(after->layers[0].base, 0u);
    store.reset();
    // Simulates a kill: the new files were written, and the old ones were not removed.
    {
        std::ofstream(folder.path / "base" / "1-9999") << "of a base that never was";
    }
    {
        RawRecords raw(folder.path);
        for (int revision = 1; revision <= 3'000; ++revision) {
            std::string key(8, '\0');
            key[6] = char(revision >> 8);
            key[7] = char(revision);
            raw.put(RawRecords::Commits, key, "old");
        }
    }
    store = open(folder.path);
    EXPECT_FALSE(fs::exists(folder.path / "base" / "1-9999"));
    EXPECT_EQ(store->loadLayer(kStoredLayer).value()->dump(), commits.layers[kStoredLayer].dump());
    EXPECT_EQ(store->loadLayer(other).value()->dump(), commits.layers[other].dump());
    store.reset();
    EXPECT_EQ(RawRecords(folder.path).keys(RawRecords::Commits).size(), 1u);
}

TEST(RocksCommitStore, AnOldRevisionBeginsWithTheNearestSnapshot) {
    TestFolder folder;
    TestCommits commits;
    auto store = open(folder.path);
    const auto costAt = [&](Revision revision) {
        Replayed replayed;
        EXPECT_TRUE(store->layerAt(kStoredLayer, revision, &replayed));
        return replayed.cost;
    };
    std::map<Revision, std::string> contents;
    for (int part = 0; part < 40; ++part) {
        append(*store, someCommits(commits, 20, unsigned(part)));
        contents[commits.head.revision] = commits.layers[kStoredLayer].dump();
        ASSERT_TRUE(keep(*store, commits));
    }
    const auto checkAll = [&](Revision from) {
        for (const auto& [revision, dump] : contents) {
            if (revision < from) continue;
            EXPECT_EQ(store->layerAt(kStoredLayer, revision).value()->dump(), dump);
            // Seven snapshots of 800 commits; executing a commit costs some 500.
            EXPECT_LT(costAt(revision), 250 * 600u) << revision;
        }
    };
    EXPECT_LE(filesOf(folder.path / "snapshots").size(), 7u);
    checkAll(0);
    store.reset();
    store = open(folder.path);
    checkAll(0);
    EXPECT_EQ(costAt(800), 0u);
    ASSERT_TRUE(store->compact(500, always));
    for (const fs::path& file : filesOf(folder.path / "snapshots"))
        if (const auto name = file.filename().string(); name != "1") {
            EXPECT_GE(std::stoul(name.substr(2)), 500u);
        }
    checkAll(500);
}

TEST(RocksCommitStore, ABaseIsMadeWhileOtherCallsRun) {
    TestFolder folder;
    TestCommits commits;
    auto quick = storeOptions();
    quick.durability = Durability::OperatingSystem;
    const auto store = std::move(*createRocksCommitStore(folder.path, quick));
    append(*store, std::vector{commits.next(kStoredLayer, "/A", CreateSpec{SpecKind::Prim})});
    std::atomic<bool> done = false;
    std::vector<std::thread> others;
    const auto mayBeReplaced = [](const auto& result) {
        return result || result.error().code == ErrorCode::HistoryReplaced;
    };
    others.emplace_back([&] {
        while (!done) {
            EXPECT_TRUE(store->compact(store->head().revision, always));
        }
    });
    others.emplace_back([&] {
        while (!done) {
            const auto head = store->head();
            EXPECT_TRUE(mayBeReplaced(
                store->read(0, head.revision, [](const StoredCommit&) { return true; })));
            EXPECT_TRUE(mayBeReplaced(store->layerAt(kStoredLayer, head.revision)));
            EXPECT_TRUE(store->loadLayer(kStoredLayer));
            EXPECT_TRUE(mayBeReplaced(store->hashAt(head.revision)));
            EXPECT_TRUE(store->setSaved(kStoredLayer, {head.revision, test::kFile}));
        }
    });
    append(*store, someCommits(commits, 300));
    done = true;
    for (auto& other : others) other.join();
    EXPECT_EQ(store->loadLayer(kStoredLayer).value()->dump(), commits.layers[kStoredLayer].dump());
    EXPECT_GT(store->base().revision, 0u);
}

TEST(RocksCommitStore, SupportedOlderFormatsAreUpgraded) {
    TestFolder folder;
    TestCommits commits;
    append(*open(folder.path), someCommits(commits, 100));
    writeFormat(folder.path, 2);
    EXPECT_EQ(open(folder.path)->head().hash, commits.head.hash);
    writeFormat(folder.path, 3);  // and compress no commit
    EXPECT_EQ(open(folder.path)->loadLayer(kStoredLayer).value()->dump(),
              commits.layers[kStoredLayer].dump());
}

TEST(RocksCommitStore, BigCommitsAreStoredCompressed) {
    TestFolder folder;
    TestCommits commits;
    LayerDoc big;
    for (int i = 0; i < 20'000; ++i)
        ASSERT_TRUE(big.apply("/P" + std::to_string(i), CreateSpec{SpecKind::Prim}));
    const CommitRecord import = commits.import(kStoredLayer, big);
    append(*open(folder.path), std::vector{import});
    {
        const RawRecords raw(folder.path);
        const auto keys = raw.keys(RawRecords::Commits);
        ASSERT_EQ(keys.size(), 1u);
        EXPECT_LT(raw.get(RawRecords::Commits, keys[0]).size(), import.frame->size() / 4);
    }
    {
        const auto store = open(folder.path);
        EXPECT_EQ(store->loadLayer(kStoredLayer).value()->dump(), big.dump());
        Bytes found;
        ASSERT_TRUE(store->read(1, 1, [&](const StoredCommit& commit) {
            found = *commit.frame;
            return true;
        }));
        EXPECT_TRUE(found == *import.frame) << "the acknowledged commits, byte for byte";
    }
    {
        RawRecords raw(folder.path);
        const auto key = raw.keys(RawRecords::Commits)[0];
        std::string record = raw.get(RawRecords::Commits, key);
        record[sizeof(Hash::bytes) + 4] ^= 1;  // the size of the content
        raw.put(RawRecords::Commits, key, record);
    }
    const auto damaged = createRocksCommitStore(folder.path, storeOptions());
    ASSERT_FALSE(damaged);
    EXPECT_EQ(damaged.error().code, ErrorCode::StorageCorrupt);
}

TEST(RocksCommitStore, AnUnknownFormatIsNotTouched) {
    const std::map<std::uint8_t, ErrorCode> formats{{std::uint8_t(1), ErrorCode::StorageCorrupt},
                                                    {std::uint8_t(6), ErrorCode::StorageTooNew}};
    for (const auto& [format, code] : formats) {
        TestFolder folder;
        (void)open(folder.path);
        writeFormat(folder.path, format);
        const auto opened = createRocksCommitStore(folder.path, storeOptions());
        ASSERT_FALSE(opened);
        EXPECT_EQ(opened.error().code, code);
    }
}

TEST(RocksCommitStore, NothingIsAcknowledgedAfterTheFolderWasRemoved) {
    for (const bool replaced : {false, true}) {
        TestFolder folder;
        TestCommits commits;
        const fs::path store = folder.path / "store", aside = folder.path / "aside";
        auto opened = open(store);
        append(*opened, someCommits(commits, 3));
        const auto acknowledged = commits.head;
        fs::rename(store, aside);
        if (replaced) {
            fs::create_directories(store);
            std::ofstream(store / "lock");
        }
        const auto refused = opened->append(someCommits(commits, 1));
        ASSERT_FALSE(refused);
        EXPECT_EQ(refused.error().code, ErrorCode::StorageFailed);
        EXPECT_NE(refused.error().message.find("was deleted, moved or replaced"),
                  std::string::npos);
        EXPECT_TRUE(opened->hasSpace()) << "the disk is not full";
        opened.reset();
        fs::remove_all(store);
        fs::rename(aside, store);
        EXPECT_EQ(open(store)->head().hash, acknowledged.hash);
    }
}

TEST(RocksCommitStore, OnlyOneProcessHasItOpen) {
    TestFolder folder;
    auto store = open(folder.path);
    const auto second = createRocksCommitStore(folder.path, storeOptions());
    ASSERT_FALSE(second);
    EXPECT_EQ(second.error().code, ErrorCode::StorageLocked);
    EXPECT_TRUE(store->append({}));
    store.reset();
    EXPECT_EQ(open(folder.path)->head().epoch, 2u);
}

TEST(RocksCommitStore, AFolderThatCannotBeMadeFails) {
    const auto opened = createRocksCommitStore("/proc/usdlive", storeOptions());
    ASSERT_FALSE(opened);
    EXPECT_EQ(opened.error().code, ErrorCode::StorageFailed);
    EXPECT_NE(opened.error().message.find("/proc/usdlive"), std::string::npos);
}

TEST(RocksCommitStore, RefusesEditsBelowTheLeastFreeSpace) {
    TestFolder folder;
    auto tight = storeOptions();
    tight.minFreeBytes = std::uint64_t(1) << 60;
    const auto store = createRocksCommitStore(folder.path, tight);
    ASSERT_TRUE(store) << store.error().message;
    EXPECT_FALSE((*store)->hasSpace());
}

TEST(RocksCommitStore, ASampleOfManyIsASmallWrite) {
    TestFolder folder;
    TestCommits commits;
    const auto store = open(folder.path);
    TimeSamples many;
    for (int time = 0; time < 100'000; ++time) many.samples.emplace(time, doubleValue(time));
    append(*store, std::vector{commits.next(kStoredLayer, "/", SetField{"timeSamples", {}, many})});
    const auto written = [&] {
        std::uintmax_t bytes = 0;
        for (const auto& log : filesOf(folder.path, ".log")) bytes += fs::file_size(log);
        return bytes;
    };
    const auto before = written();
    append(*store,
           std::vector{commits.next(kStoredLayer, "/",
                                    SetField{"timeSamples", SampleTime{500}, doubleValue(-1)})});
    EXPECT_LT(written() - before, 2'000u);
    EXPECT_EQ(store->loadLayer(kStoredLayer).value()->dump(), commits.layers[kStoredLayer].dump());
}

TEST(RocksCommitStore, ReadersWorkWhileItAppends) {
    TestFolder folder;
    TestCommits commits;
    auto quick = storeOptions();
    quick.durability = Durability::OperatingSystem;
    const auto store = std::move(*createRocksCommitStore(folder.path, quick));
    append(*store, std::vector{commits.next(kStoredLayer, "/A", CreateSpec{SpecKind::Prim})});
    std::atomic<bool> done = false;
    std::vector<std::thread> readers;
    for (int reader = 0; reader < 2; ++reader)
        readers.emplace_back([&] {
            while (!done) {
                const auto head = store->head();
                EXPECT_TRUE(
                    store->read(1, head.revision, [](const StoredCommit&) { return true; }));
                EXPECT_TRUE(store->loadLayer(kStoredLayer));
                EXPECT_TRUE(store->setSaved(kStoredLayer, {head.revision, test::kFile}));
                EXPECT_TRUE(store->unsavedLayers());
                EXPECT_TRUE(store->hasSpace());
            }
        });
    append(*store, someCommits(commits, 300));
    done = true;
    for (auto& reader : readers) reader.join();
    EXPECT_EQ(store->loadLayer(kStoredLayer).value()->dump(), commits.layers[kStoredLayer].dump());
}

/// Limits the length of files, so that writes fail as on a failing disk.
class FileLimit {
public:
    explicit FileLimit(rlim_t bytes) {
        ::signal(SIGXFSZ, SIG_IGN);
        ::getrlimit(RLIMIT_FSIZE, &before_);
        const rlimit limit{bytes, before_.rlim_max};
        ::setrlimit(RLIMIT_FSIZE, &limit);
    }
    ~FileLimit() { ::setrlimit(RLIMIT_FSIZE, &before_); }

private:
    rlimit before_{};
};

// Every connection is a client of its own.
TEST(RocksCommitStore, M14RecordsOfManyClientsAreBounded) {
    constexpr std::size_t kClients = seedsOf(100'000), kKept = 1'000;
    TestFolder folder;
    RocksCommitStoreOptions options;
    options.durability = Durability::OperatingSystem;
    options.minFreeBytes = 0;
    const auto store = std::move(*createRocksCommitStore(folder.path, options));
    TestCommits commits;
    std::vector<CommitRecord> group;
    std::size_t forgotten = 0;
    const auto id = [](std::size_t number) {
        return ClientId{sha256(asBytes(std::to_string(number))).hex().substr(0, 32)};
    };
    for (std::size_t number = 1; number <= kClients; ++number) {
        for (const std::uint64_t sequence : {1, 2}) {
            commits.id = {id(number), sequence - 1};
            group.push_back(commits.empty());
        }
        if (number % (kClients / 20) != 0) continue;
        ASSERT_TRUE(store->append(group));
        group.clear();
        const auto some = store->forgetClients(kKept, {});
        ASSERT_TRUE(some) << some.error().message;
        forgotten += *some;
    }
    EXPECT_GE(forgotten, kClients - kKept);
    EXPECT_GE(store->forgottenUpTo(), 2 * (kClients - kKept));
    std::size_t known = 0;
    for (std::size_t number = 1; number <= kClients; ++number) {
        const auto record = store->clientRecord(id(number));
        ASSERT_TRUE(record);
        if (record->last() == 0) {
            // The commits of a forgotten client are not newer than forgottenUpTo().
            ASSERT_LE(2 * number, store->forgottenUpTo());
            continue;
        }
        ++known;
        ASSERT_EQ(record->find(2), Revision(2 * number));
    }
    EXPECT_LE(known, kKept);
    EXPECT_GE(known, kKept / 2);
}

TEST(RocksCommitStore, AFailedWriteIsNotTriedAgain) {
    TestFolder folder;
    TestCommits commits;
    auto store = open(folder.path);
    append(*store, std::vector{commits.next(kStoredLayer, "/A", CreateSpec{SpecKind::Prim})});
    const auto commit = commits.next(
        kStoredLayer, "/", SetField{"comment", {}, stringValue(std::string(50'000, 'x'))});
    {
        const FileLimit limit(20'000);
        EXPECT_EQ(store->append({&commit, 1}).error().code, ErrorCode::StorageFailed);
    }
    EXPECT_EQ(store->append({&commit, 1}).error().code, ErrorCode::StorageFailed);
    EXPECT_EQ(store->setSaved(kStoredLayer, {1, {}}).error().code, ErrorCode::StorageFailed);
    EXPECT_EQ(store->head().revision, 1u);
    store.reset();
    store = open(folder.path);
    EXPECT_EQ(store->head().revision, 1u);
    append(*store, std::vector{commit});
    EXPECT_EQ(store->loadLayer(kStoredLayer).value()->dump(), commits.layers[kStoredLayer].dump());
}

CommitRecord bigCommit(TestCommits& commits, std::mt19937& random, std::size_t bytes) {
    std::string text(bytes, ' ');
    for (char& letter : text) letter = char('0' + random() % 64);
    return commits.next(kStoredLayer, "/", SetField{"comment", {}, stringValue(text)});
}

// D1: RocksDB as built by Debian ends the process when a write finds the disk full.
TEST(RocksCommitStore, AFullDiskRefusesAndRecovers) {
    const SmallDisk disk("size=96m");
    if (!disk) GTEST_SKIP() << "cannot mount a small disk";
    RocksCommitStoreOptions tight;
    tight.minFreeBytes = 16 * kMib;
    const fs::path folder = disk.path() / "store", ballast = disk.path() / "ballast";
    auto opened = createRocksCommitStore(folder, tight);
    ASSERT_TRUE(opened) << opened.error().message;
    auto store = std::move(*opened);
    TestCommits commits;
    std::mt19937 random(1);

    for (int round = 0; round < 4; ++round) {
        SCOPED_TRACE(round);
        bool full = false;
        for (int step = 0; step < 2'000 && !full; ++step) {
            const TestCommits before = commits;
            const auto commit = bigCommit(commits, random, 64 * 1024);
            const auto appended = store->append({&commit, 1});
            if (appended) {
                // Somebody else fills the disk as well, until nothing is free.
                std::ofstream other(ballast, std::ios::app | std::ios::binary);
                other << std::string(1024 * 1024, 'x');
                continue;
            }
            ASSERT_EQ(appended.error().code, ErrorCode::StorageFull) << appended.error().message;
            commits = before;
            full = true;
        }
        ASSERT_TRUE(full);
        EXPECT_EQ(store->head().revision, commits.head.revision);
        // A log can still be freed after its content has been written to a table.
        for (int left = 20; left > 0 && (disk.free() > 0 || store->hasSpace()); --left) {
            std::ofstream(ballast, std::ios::app) << std::string(disk.free(), 'x');
            std::this_thread::sleep_for(std::chrono::milliseconds(150));
        }
        EXPECT_FALSE(store->hasSpace());
        EXPECT_EQ(store->append({}).has_value(), true);
        EXPECT_TRUE(store->loadLayer(kStoredLayer)) << "reading continues";

        if (round % 2) {
            store.reset();  // closing the store needs no space
            fs::remove(ballast);
            store = std::move(*createRocksCommitStore(folder, tight));
        }
        fs::remove(ballast);
        std::this_thread::sleep_for(std::chrono::milliseconds(150));
        EXPECT_TRUE(store->hasSpace()) << disk.free() / kMib << " MiB free";
        const auto commit = bigCommit(commits, random, 1024);
        const auto appended = store->append({&commit, 1});
        ASSERT_TRUE(appended) << appended.error().message;
    }
    store.reset();
    EXPECT_TRUE(openIsEqualOrCorrupt(folder, commits));
    EXPECT_EQ(open(folder)->head().revision, commits.head.revision);
}

// Somebody else fills the disk at the moment when the store writes a table.
TEST(RocksCommitStore, ADiskThatFillsBehindItsTablesIsNoFailure) {
    constexpr std::uint64_t kSize = 192 * kMib;
    const SmallDisk disk("size=192m");
    if (!disk) GTEST_SKIP() << "cannot mount a small disk";
    RocksCommitStoreOptions tight;
    tight.minFreeBytes = 16 * kMib;
    const fs::path folder = disk.path() / "store";
    const auto opened = [&] { return std::move(*createRocksCommitStore(folder, tight)); };
    auto store = opened();
    TestCommits commits;
    std::mt19937 random(3);
    for (int round = 0; round < 2; ++round) {
        SCOPED_TRACE(round);
        const auto tables = filesOf(folder, ".sst");
        for (int step = 0; step < 200 && filesOf(folder, ".sst") == tables; ++step) {
            const auto commit = bigCommit(commits, random, 256 * 1024);
            ASSERT_TRUE(store->append({&commit, 1}));
        }
        disk.fill();
        std::this_thread::sleep_for(std::chrono::milliseconds(100));
        const auto commit = bigCommit(commits, random, 1'000);
        auto appended = store->append({&commit, 1});
        if (!appended) {
            EXPECT_EQ(appended.error().code, ErrorCode::StorageFull) << appended.error().message;
        }
        ASSERT_TRUE(disk.resize(kSize));
        if (round % 2) {
            store.reset();  // does not wait for the table
            store = opened();
        }
        for (int left = 100; left > 0 && !appended; --left) {
            std::this_thread::sleep_for(std::chrono::milliseconds(20));
            appended = store->append({&commit, 1});
        }
        ASSERT_TRUE(appended) << appended.error().message;
    }
    EXPECT_EQ(store->loadLayer(kStoredLayer).value()->dump(), commits.layers[kStoredLayer].dump());
}

// The store itself fills the disk, while its tables are written and merged in the background.
TEST(RocksCommitStore, FillsADiskToItsLimit) {
    const SmallDisk disk("size=160m");
    if (!disk) GTEST_SKIP() << "cannot mount a small disk";
    RocksCommitStoreOptions tight;
    tight.minFreeBytes = 24 * kMib;
    const fs::path folder = disk.path() / "store", ballast = disk.path() / "ballast";
    TestCommits commits;
    std::mt19937 random(2);
    for (int round = 0; round < 3; ++round) {
        SCOPED_TRACE(round);
        std::ofstream(ballast, std::ios::binary) << std::string((3 - round) * 24 * kMib, 'x');
        auto opened = createRocksCommitStore(folder, tight);
        ASSERT_TRUE(opened) << opened.error().message;
        for (;;) {
            const TestCommits before = commits;
            const auto commit = bigCommit(commits, random, 20'000 + random() % 200'000);
            const auto appended = (*opened)->append({&commit, 1});
            if (appended) continue;
            ASSERT_EQ(appended.error().code, ErrorCode::StorageFull) << appended.error().message;
            commits = before;
            break;
        }
        EXPECT_EQ((*opened)->loadLayer(kStoredLayer).value()->dump(),
                  commits.layers[kStoredLayer].dump());
        fs::remove(ballast);
        // RocksDB frees the space of merged tables, and recovers, in the background.
        const auto commit = bigCommit(commits, random, 1'000);
        auto appended = (*opened)->append({&commit, 1});
        for (int left = 200; left > 0 && !appended; --left) {
            ASSERT_EQ(appended.error().code, ErrorCode::StorageFull) << appended.error().message;
            std::this_thread::sleep_for(std::chrono::milliseconds(100));
            if ((*opened)->hasSpace()) appended = (*opened)->append({&commit, 1});
        }
        ASSERT_TRUE(appended) << appended.error().message;
    }
    EXPECT_GT(commits.head.revision, 300u) << "most of the disk was used";
    EXPECT_EQ(createRocksCommitStore(folder, tight).value()->head().revision,
              commits.head.revision);
}

TEST(RocksCommitStore, ACopyThatIsMadeMeanwhileHasWhatWasDurable) {
    TestFolder folder;
    TestCommits commits;
    const auto all = someCommits(commits, 400);
    const auto store = open(folder.path / "store");
    append(*store, std::span(all).first(50));
    std::atomic<std::size_t> appended = 50;
    std::thread writer([&] {
        for (std::size_t next = 50; next < all.size(); ++next) {
            ASSERT_TRUE(store->append(std::span(all).subspan(next, 1)));
            appended = next + 1;
            if (next == 200) {
                ASSERT_TRUE(store->compact(150, always));
            }
        }
    });
    std::vector<std::pair<fs::path, std::size_t>> copies;
    while (appended < all.size() || copies.size() < 3) {
        const fs::path to = folder.path / ("copy" + std::to_string(copies.size()));
        const std::size_t before = appended;
        const auto copied = store->copyTo(to);
        ASSERT_TRUE(copied) << copied.error().message;
        copies.emplace_back(to, before);
    }
    writer.join();
    for (const auto& [path, before] : copies) {
        const auto copy = open(path);
        const Revision head = copy->head().revision;
        ASSERT_GE(head, before);
        if (head >= store->base().revision) {
            EXPECT_EQ(copy->head().hash, *store->hashAt(head));
        }
        ASSERT_EQ(copy->identity(), store->identity());
        const auto read =
            copy->read(copy->base().revision + 1, head, [](const StoredCommit&) { return true; });
        ASSERT_TRUE(read) << read.error().message;
        ASSERT_TRUE(copy->loadLayer(kStoredLayer));
        EXPECT_TRUE(copy->append({})) << "it is a store like any other";
    }
    EXPECT_EQ(store->copyTo(copies.front().first).error().code, ErrorCode::InvalidArgument);
}

}  // namespace
}  // namespace usdlive::server
