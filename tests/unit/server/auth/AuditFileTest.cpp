// Tests the files of the audit log (AU2, AU3).
#include "auth/AuditFile.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>
#include <vector>

namespace usdlive::server {
namespace {

namespace fs = std::filesystem;

class AuditFileTest : public ::testing::Test {
protected:
    AuditFileTest() {
        std::string name = fs::temp_directory_path() / "audit-XXXXXX";
        folder_ = ::mkdtemp(name.data());
    }
    ~AuditFileTest() override { fs::remove_all(folder_); }

    static void append(const AuditFile& file, const std::string& detail) {
        const AuditEvent event{.event = "tested", .detail = detail, .timeMs = 1'800'000'000'123};
        ASSERT_TRUE(file.append({&event, 1}));
    }
    std::vector<std::string> lines(const AuditFile& file) {
        std::vector<std::string> all;
        const auto found = file.read(
            [&](std::uint64_t, const Hash&, std::string_view line) { all.emplace_back(line); });
        EXPECT_TRUE(found);
        EXPECT_EQ(found->damage, std::nullopt);
        EXPECT_EQ(found->records, all.size());
        return all;
    }

    fs::path folder_;
};

TEST_F(AuditFileTest, ARecordHasWhatIsKnown) {
    const AuditFile file(folder_);
    EXPECT_TRUE(lines(file).empty());
    append(file, "a \xff \"b\"\n");
    const auto record = nlohmann::json::parse(lines(file).at(0));
    EXPECT_EQ(record["number"], 1);
    EXPECT_EQ(record["time"], "2027-01-15T08:00:00.123Z");
    EXPECT_EQ(record["detail"], "a \xef\xbf\xbd \"b\"\n");
    EXPECT_FALSE(record.contains("user"));
    EXPECT_EQ(record["previous"], Hash{}.hex());
}

TEST_F(AuditFileTest, LongTextsAreCut) {
    const AuditFile file(folder_);
    append(file, std::string(100'000, '\x01'));
    append(file, "next");
    EXPECT_EQ(nlohmann::json::parse(lines(file).at(0))["detail"].get<std::string>().size(),
              AuditFile::kMostText);
    EXPECT_EQ(lines(file).size(), 2);
}

TEST_F(AuditFileTest, AChangeOfAnyByteIsFoundUnlessItIsInTheLastRecord) {
    const AuditFile file(folder_);
    for (const char* detail : {"one", "two", "three"}) append(file, detail);
    std::ifstream stream(file.path());
    const std::string whole{std::istreambuf_iterator<char>(stream), {}};
    const std::size_t last = whole.rfind('\n', whole.size() - 2) + 1;
    for (std::size_t at = 0; at < last; ++at) {
        std::string changed = whole;
        changed[at] = char(changed[at] ^ 1);
        std::ofstream(file.path()) << changed;
        const auto found = file.read([](auto...) {});
        ASSERT_TRUE(found);
        EXPECT_TRUE(found->damage) << at;
    }
}

TEST_F(AuditFileTest, TheChainGoesOnInTheNextFileAndOldFilesEnd) {
    constexpr std::uint64_t kFew = 400;  // bytes
    const AuditFile file(folder_, kFew);
    for (int number = 0; number < 100; ++number) append(file, std::to_string(number));
    const auto all = lines(file);
    ASSERT_LT(all.size(), 100);
    ASSERT_GT(all.size(), AuditFile::kMostFiles);
    EXPECT_EQ(nlohmann::json::parse(all.back())["number"], 100);
    std::size_t files = 0;
    for ([[maybe_unused]] const auto& entry : fs::directory_iterator(folder_ / ".usdlive"))
        if (entry.path().extension() == ".jsonl") ++files;
    EXPECT_EQ(files, AuditFile::kMostFiles);
    // A file in the middle that is missing is found.
    std::vector<fs::path> older;
    for (const auto& entry : fs::directory_iterator(folder_ / ".usdlive"))
        if (entry.path().filename().string().starts_with("audit-")) older.push_back(entry.path());
    std::ranges::sort(older);
    fs::remove(older[older.size() / 2]);
    const auto found = file.read([](auto...) {});
    ASSERT_TRUE(found);
    EXPECT_TRUE(found->damage);
}

TEST_F(AuditFileTest, SeveralWritersMakeOneChain) {
    std::vector<std::thread> writers;
    for (int writer = 0; writer < 4; ++writer)
        writers.emplace_back([this, writer] {
            const AuditFile file(folder_);
            for (int number = 0; number < 25; ++number) append(file, std::to_string(writer));
        });
    for (std::thread& writer : writers) writer.join();
    EXPECT_EQ(lines(AuditFile(folder_)).size(), 100);
}

TEST_F(AuditFileTest, ALinkIsNotFollowed) {
    const AuditFile file(folder_);
    fs::create_directories(file.path().parent_path());
    const fs::path victim = folder_ / "victim";
    std::ofstream(victim) << "text";
    fs::create_symlink(victim, file.path());
    const AuditEvent event{.event = "tested"};
    EXPECT_FALSE(file.append({&event, 1}));
    EXPECT_EQ(fs::file_size(victim), 4);
}

}  // namespace
}  // namespace usdlive::server
