// Tests Journal: unsent work on the disk, also after a crash.
#include "work/Journal.h"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <filesystem>
#include <fstream>

#include "unit/common/usd/MemoryBlobs.h"
#include "usdlive/common/core/ByteStream.h"
#include "work/LostWorkStore.h"

using namespace usdlive;
using client::AuthoredEdit;
using client::Journal;
using client::LeftJournal;
using client::LostWork;
using client::LostWorkStore;
using client::RecordFile;
namespace fs = std::filesystem;

namespace {

const ClientId kClient{"0123456789abcdef0123456789abcdef"};
const Hash kSecret = sha256(asBytes("secret"));
const StoreId kStore{"00112233445566778899aabbccddeeff"};

std::vector<AuthoredEdit> editsOf(int number) {
    return {{LayerId{"shot.usda"}, "/p" + std::to_string(number), CreateSpec{SpecKind::Prim}}};
}

class JournalTest : public ::testing::Test {
protected:
    JournalTest() {
        fs::remove_all(folder);
        fs::create_directories(folder);
    }
    ~JournalTest() override { fs::remove_all(folder); }

    void write(Journal& journal, int from, int to) {
        for (int number = from; number < to; ++number) {
            const auto edits = editsOf(number);
            journal.pending({std::uint64_t(number), 7, sha256(asBytes("seven")), kStore, edits});
        }
    }
    std::vector<client::UnsentWork> left(const StoreId& store = kStore) {
        std::vector<Error> damaged;
        auto found = LeftJournal::list(folder, store, damaged);
        EXPECT_TRUE(damaged.empty());
        return found;
    }

    const fs::path folder =
        fs::temp_directory_path() / ("usdlive-journal-" + std::to_string(::getpid()));
    usdlive::test::MemoryBlobs blobs;
};

TEST_F(JournalTest, KeepsUnansweredWork) {
    {
        Journal journal(folder, kClient, kSecret, blobs);
        write(journal, 1, 10);
        journal.flush();
        EXPECT_TRUE(left().empty()) << "a journal in use belongs to its process";
        for (std::uint64_t number = 1; number < 9; ++number) journal.answered(number);
        const auto sum = journal.summary();
        ASSERT_TRUE(sum);
        EXPECT_EQ(sum->transactions, 1u);
    }
    const auto found = left();
    ASSERT_EQ(found.size(), 1u);
    EXPECT_EQ(found[0].edits, 1u);
    const auto journal = LeftJournal::open(folder, kClient);
    ASSERT_TRUE(journal) << journal.error().message;
    const auto& work = journal->works().at(9);
    EXPECT_EQ(work.edits.at(0).path, "/p9");
    EXPECT_EQ(work.revision, 7u);
    EXPECT_EQ(work.hash, sha256(asBytes("seven")));
    EXPECT_EQ(work.store, kStore);
    EXPECT_EQ(journal->secret(), kSecret) << "ID5: its work is sent with its client's id";
}

// ID3: the folder of a project is named after it, and another one may have the same name.
TEST_F(JournalTest, ID3KnowsForWhichProjectItsWorkIs) {
    {
        Journal journal(folder, kClient, kSecret, blobs);
        write(journal, 1, 3);
    }
    EXPECT_FALSE(left(kStore).at(0).otherProject);
    EXPECT_FALSE(left(StoreId{}).at(0).otherProject) << "the server is of an earlier version";
    EXPECT_TRUE(left({"another"}).at(0).otherProject);
}

// A journal of an earlier version has no identity: only the chain of hashes tells where it belongs.
TEST_F(JournalTest, ID3ReadsAJournalWithoutAnIdentity) {
    {
        auto file = RecordFile::open(folder / (kClient.value + ".journal"), RecordFile::Mode::New);
        ASSERT_TRUE(file);
        Bytes record{1};  // a transaction, as it was written before
        appendNumber<std::uint64_t>(record, 5);
        appendNumber<std::int64_t>(record, 1'000);
        appendNumber<std::uint64_t>(record, 7);
        appendBytes(record, sha256(asBytes("seven")).bytes);
        appendBytes(record, client::encodeAuthored(5, editsOf(5)));
        ASSERT_TRUE(file->append({record}));
    }
    EXPECT_FALSE(left(kStore).at(0).otherProject);
    const auto journal = LeftJournal::open(folder, kClient);
    ASSERT_TRUE(journal) << journal.error().message;
    EXPECT_EQ(journal->works().at(5).edits.at(0).path, "/p5");
    EXPECT_EQ(journal->works().at(5).hash, sha256(asBytes("seven")));
}

TEST_F(JournalTest, IsRemovedWhenAllIsAnswered) {
    Journal journal(folder, kClient, kSecret, blobs);
    write(journal, 1, 100);
    journal.flush();
    EXPECT_FALSE(fs::is_empty(folder));
    for (std::uint64_t number = 1; number < 100; ++number) journal.answered(number);
    journal.flush();
    EXPECT_TRUE(fs::is_empty(folder));
    EXPECT_FALSE(journal.summary());
    write(journal, 100, 101);
    journal.flush();
    EXPECT_FALSE(fs::is_empty(folder));
}

// A crash may cut the file anywhere: complete records are kept.
TEST_F(JournalTest, ATornRecordEndsTheJournal) {
    {
        Journal journal(folder, kClient, kSecret, blobs);
        write(journal, 1, 4);
    }
    const fs::path file = folder / (kClient.value + ".journal");
    const auto size = fs::file_size(file);
    std::size_t before = 3;
    for (auto cut = size; cut-- > 0;) {
        fs::resize_file(file, cut);
        const auto journal = LeftJournal::open(folder, kClient);
        ASSERT_TRUE(journal) << journal.error().message;
        EXPECT_LE(journal->works().size(), before);
        before = journal->works().size();
    }
    EXPECT_EQ(before, 0u);
}

// A disk may change what it keeps: what cannot be read is reported, and not removed.
TEST_F(JournalTest, ADamagedRecordIsReportedAndItsFileIsKept) {
    {
        Journal journal(folder, kClient, kSecret, blobs);
        write(journal, 1, 3);
    }
    const fs::path file = folder / (kClient.value + ".journal");
    std::fstream stream(file, std::ios::in | std::ios::out | std::ios::binary);
    stream.seekp(-1, std::ios::end);
    stream.put('x');
    stream.close();
    std::vector<Error> damaged;
    const auto found = LeftJournal::list(folder, kStore, damaged);
    ASSERT_EQ(found.size(), 1u);
    EXPECT_EQ(found[0].transactions, 1u);
    ASSERT_EQ(damaged.size(), 1u);
    EXPECT_EQ(damaged[0].code, ErrorCode::StorageCorrupt);
    LeftJournal::open(folder, kClient)->remove();
    EXPECT_TRUE(left().empty());
    EXPECT_TRUE(fs::exists(folder / (kClient.value + ".damaged")));
}

// B7: a drag replaces its work again and again; only the values that the work still names are kept.
TEST_F(JournalTest, B7KeepsTheBigValuesThatItsWorkNames) {
    const auto dragged = [&](int number) {
        const auto bytes = std::make_shared<const Bytes>(1'000, std::uint8_t(number));
        const Hash hash = sha256(ByteView(*bytes));
        blobs.all = {{hash, bytes}};
        return std::vector<AuthoredEdit>{
            {LayerId{"shot.usda"}, "/p.x",
             SetField{"default", {}, Value::blob(arrayOf(ValueType::Float), hash, 1'000), {}}}};
    };
    const fs::path values = folder / (kClient.value + ".blobs");
    const auto count = [&] { return std::distance(fs::directory_iterator(values), {}); };
    Journal journal(folder, kClient, kSecret, blobs);
    for (int number = 0; number < 20; ++number) {
        const auto edits = dragged(number);
        journal.pending({1, 7, sha256(asBytes("seven")), kStore, edits});
        EXPECT_EQ(journal.neededBlobs().size(), 1u);
        journal.flush();
        EXPECT_EQ(count(), 1);
        EXPECT_TRUE(journal.neededBlobs().empty());
    }
    const auto same = dragged(19);
    journal.pending({2, 7, sha256(asBytes("seven")), kStore, same});
    journal.flush();
    journal.answered(1);
    journal.flush();
    EXPECT_EQ(count(), 1) << "another work names it";
    journal.answered(2);
    journal.flush();
    EXPECT_FALSE(fs::exists(values));
}

// Simulates a full disk: there is room for the value, but not for the record that names it.
TEST_F(JournalTest, B7ValuesOfWorkThatCannotBeWrittenAreRemoved) {
    const auto bytes = std::make_shared<const Bytes>(1'000, std::uint8_t(1));
    const Hash hash = sha256(ByteView(*bytes));
    blobs.all = {{hash, bytes}};
    const std::vector<AuthoredEdit> edits{
        {LayerId{"shot.usda"}, "/p.x",
         SetField{"default", {}, Value::blob(arrayOf(ValueType::Float), hash, 1'000), {}}},
        {LayerId{"shot.usda"}, "/" + std::string(20'000, 'p'), CreateSpec{SpecKind::Prim}}};
    const auto handler = std::signal(SIGXFSZ, SIG_IGN);
    rlimit before{};
    ASSERT_EQ(::getrlimit(RLIMIT_FSIZE, &before), 0);
    const rlimit small{10'000, before.rlim_max};
    ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &small), 0);
    Journal journal(folder, kClient, kSecret, blobs);
    journal.pending({1, 7, sha256(asBytes("seven")), kStore, edits});
    journal.flush();
    ::setrlimit(RLIMIT_FSIZE, &before);
    std::signal(SIGXFSZ, handler);
    EXPECT_TRUE(journal.takeError());
    const fs::path values = folder / (kClient.value + ".blobs");
    EXPECT_TRUE(fs::is_empty(values));
    EXPECT_EQ(journal.neededBlobs(), std::set<Hash>{hash});
    journal.flush();
}

TEST_F(JournalTest, B7ValuesWithoutTheirJournalAreRemoved) {
    const fs::path old = folder / "00.blobs", fresh = folder / "11.blobs";
    for (const fs::path& values : {old, fresh}) {
        fs::create_directories(values);
        std::ofstream(values / "value") << "x";
    }
    fs::last_write_time(old, fs::file_time_type::clock::now() - std::chrono::hours(2));
    EXPECT_TRUE(left().empty());
    EXPECT_FALSE(fs::exists(old));
    EXPECT_TRUE(fs::exists(fresh)) << "another process may use it";
}

TEST_F(JournalTest, SaysOnceThatItCannotBeWritten) {
    std::ofstream(folder / "file") << "in the way";
    Journal journal(folder / "file", kClient, kSecret, blobs);
    write(journal, 1, 2);
    journal.flush();
    const auto error = journal.takeError();
    ASSERT_TRUE(error);
    EXPECT_NE(error->message.find("unsent work is not kept"), std::string::npos);
    EXPECT_FALSE(journal.takeError());
}

TEST_F(JournalTest, LostWorkMovesToTheDiskAndKeepsItsIndex) {
    LostWorkStore store(folder / "lost", 10);
    for (int number = 0; number < 1'000; ++number) {
        LostWork work;
        work.sequence = std::uint64_t(number);
        work.reason = {ErrorCode::Locked, "number " + std::to_string(number)};
        work.edits = editsOf(number);
        ASSERT_TRUE(store.add(std::move(work)));
    }
    ASSERT_EQ(store.size(), 1'000u);
    for (int number = 0; number < 1'000; ++number) {
        const auto work = store.at(std::uint64_t(number));
        ASSERT_TRUE(work) << work.error().message;
        EXPECT_EQ(work->reason.message, "number " + std::to_string(number));
        EXPECT_EQ(work->reason.code, ErrorCode::Locked);
        EXPECT_EQ(work->edits.at(0).path, "/p" + std::to_string(number));
    }
    EXPECT_FALSE(store.at(1'000));
}

}  // namespace
