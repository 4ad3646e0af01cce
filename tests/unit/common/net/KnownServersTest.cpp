// Tests the file of known servers: its entries, its mode, and what is sent to a server.
#include "usdlive/common/net/KnownServers.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdlib>
#include <fstream>
#include <thread>

#include "usdlive/common/net/Invitation.h"

using namespace usdlive;
namespace fs = std::filesystem;

namespace {

class KnownServersTest : public testing::Test {
protected:
    KnownServersTest() { fs::remove_all(folder_); }
    ~KnownServersTest() override { fs::remove_all(folder_); }

    const fs::path folder_ = fs::temp_directory_path() / ("known" + std::to_string(::getpid()));
    const KnownServers known_{folder_ / "usdlive"};
    const KnownServer ada_{"ada", "secret", "sha256:00", true};
};

TEST_F(KnownServersTest, KeepsOneEntryForEachHostAndPort) {
    ASSERT_TRUE(known_.keep("Render.Example", 7447, ada_));
    ASSERT_TRUE(known_.keep("::1", 7447, {"bo", "", "", false}));
    EXPECT_EQ(known_.find("render.example", 7447)->value(), ada_);
    EXPECT_EQ(known_.find("[::1]", 7447)->value().user, "bo");
    EXPECT_FALSE(known_.find("render.example", 7448)->has_value());
    EXPECT_TRUE(known_.forget("RENDER.example", 7447).value());
    EXPECT_FALSE(known_.forget("render.example", 7447).value());
    EXPECT_FALSE(known_.find("render.example", 7447)->has_value());
    EXPECT_TRUE(known_.find("::1", 7447)->has_value());
}

TEST_F(KnownServersTest, AnUpdateKeepsTheRest) {
    ASSERT_TRUE(known_.keep("host", 1, ada_));
    ASSERT_TRUE(known_.update("host", 1, [](KnownServer& server) { server.pin = "sha256:11"; }));
    KnownServer expected = ada_;
    expected.pin = "sha256:11";
    EXPECT_EQ(known_.find("host", 1)->value(), expected);
}

/// Sets a variable of the environment until its end.
class SetVariable {
public:
    SetVariable(const char* name, const std::string& value) : name_(name) {
        ::setenv(name, value.c_str(), 1);
    }
    ~SetVariable() { ::unsetenv(name_); }
    SetVariable(const SetVariable&) = delete;
    SetVariable& operator=(const SetVariable&) = delete;

private:
    const char* name_;
};

TEST_F(KnownServersTest, AC12AGivenTokenIsForItsServerOnly) {
    ASSERT_TRUE(known_.keep("host", 1, ada_));
    ASSERT_TRUE(known_.keep("host", 2, ada_));
    const std::string code(64, 'a');
    const std::string token = ServiceToken{"farm", {"host", 1, code, false, ""}}.text();
    const KnownServer farm{"farm", code, ada_.pin, true};
    {
        const SetVariable given("USDLIVE_TOKEN", token);
        EXPECT_EQ(known_.find("HOST", 1)->value(), farm);
        EXPECT_EQ(known_.find("host", 2)->value(), ada_);
        EXPECT_FALSE(known_.find("other", 1)->has_value());
        EXPECT_EQ(known_.authorization("host", 1, true).value(), "Bearer " + code);
        EXPECT_FALSE(known_.authorization("host", 1, false).value()) << "it is an encrypted server";
        EXPECT_EQ(KnownServers("").find("host", 1)->value().token, code);
    }
    EXPECT_EQ(known_.find("host", 1)->value(), ada_);
    const fs::path file = folder_ / "token";
    std::ofstream(file) << token << "\n";
    const SetVariable given("USDLIVE_TOKEN_FILE", file.string());
    fs::permissions(file, fs::perms(0644));
    const auto open = known_.find("host", 1);
    ASSERT_FALSE(open);
    EXPECT_NE(open.error().message.find("chmod 600 " + file.string()), std::string::npos);
    fs::permissions(file, fs::perms(0600));
    EXPECT_EQ(known_.find("host", 1)->value(), farm);
    std::ofstream(file) << code;
    const auto damaged = known_.find("host", 1);
    ASSERT_FALSE(damaged);
    EXPECT_EQ(damaged.error().message.find(code), std::string::npos);
    EXPECT_NE(damaged.error().message.find("USDLIVE_TOKEN_FILE"), std::string::npos);
    fs::remove(file);
    EXPECT_FALSE(known_.find("host", 1));
}

TEST_F(KnownServersTest, OnlyThisUserCanReadTheFile) {
    ASSERT_TRUE(known_.keep("host", 1, ada_));
    const fs::path file = folder_ / "usdlive" / "servers.json";
    EXPECT_EQ(fs::status(file).permissions(), fs::perms(0600));
    EXPECT_EQ(fs::status(file.parent_path()).permissions(), fs::perms(0700));
    fs::permissions(file, fs::perms(0640));
    const auto found = known_.find("host", 1);
    ASSERT_FALSE(found);
    EXPECT_NE(found.error().message.find("chmod 600 " + file.string()), std::string::npos);
    EXPECT_FALSE(known_.keep("host", 2, ada_));
}

TEST_F(KnownServersTest, AFileThatIsNotValidIsNotReplaced) {
    ASSERT_TRUE(known_.keep("host", 1, ada_));
    const fs::path file = folder_ / "usdlive" / "servers.json";
    std::ofstream(file) << "{";
    EXPECT_FALSE(known_.keep("host", 2, ada_));
    EXPECT_FALSE(known_.find("host", 1));
    EXPECT_EQ(fs::file_size(file), 1u);
}

TEST_F(KnownServersTest, WritersDoNotLoseEachOthersEntries) {
    std::vector<std::thread> writers;
    for (std::uint16_t writer = 1; writer <= 4; ++writer)
        writers.emplace_back([this, writer] {
            for (std::uint16_t round = 0; round < 20; ++round)
                EXPECT_TRUE(known_.keep("host", std::uint16_t(writer * 100 + round), ada_));
        });
    for (auto& writer : writers) writer.join();
    for (std::uint16_t writer = 1; writer <= 4; ++writer)
        for (std::uint16_t round = 0; round < 20; ++round)
            EXPECT_TRUE(known_.find("host", std::uint16_t(writer * 100 + round))->has_value());
}

TEST_F(KnownServersTest, ATokenOfAnEncryptedConnectionIsNotSentInPlainText) {
    ASSERT_TRUE(known_.keep("host", 1, ada_));
    EXPECT_EQ(known_.authorization("host", 1, true)->value(), "Bearer secret");
    EXPECT_FALSE(known_.authorization("host", 1, false)->has_value());
    ASSERT_TRUE(known_.keep("host", 2, {"bo", "other", "", false}));
    EXPECT_EQ(known_.authorization("host", 2, false)->value(), "Bearer other");
}

TEST_F(KnownServersTest, TheTokenOfTheOwnerIsForThisMachineOnly) {
    const fs::path file = folder_ / "usdlive" / "local" / "7447";
    fs::create_directories(file.parent_path());
    std::ofstream(file) << "mine\n";
    fs::permissions(file, fs::perms(0600));
    EXPECT_EQ(known_.authorization("127.0.0.1", 7447, false)->value(), "Bearer mine");
    EXPECT_EQ(known_.authorization("[::1]", 7447, true)->value(), "Bearer mine");
    EXPECT_FALSE(known_.authorization("127.0.0.1", 7448, false)->has_value());
    EXPECT_FALSE(known_.authorization("127.0.0.1.example", 7447, false)->has_value());
    EXPECT_FALSE(known_.authorization("other", 7447, false)->has_value());
    fs::permissions(file, fs::perms(0644));
    EXPECT_FALSE(known_.authorization("localhost", 7447, false)->has_value());
}

TEST(KnownServersOfNobody, AnUnknownFolderIsAnErrorForWritersOnly) {
    const KnownServers nobody{fs::path()};
    EXPECT_FALSE(nobody.find("host", 1)->has_value());
    EXPECT_FALSE(nobody.keep("host", 1, {}));
}

}  // namespace
