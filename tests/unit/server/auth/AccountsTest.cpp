// Tests the accounts of a server (AC1, AC2).
#include "auth/Accounts.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <fstream>
#include <thread>

#include "auth/SignIn.h"

namespace usdlive::server {
namespace {

namespace fs = std::filesystem;

constexpr std::int64_t kNow = 1'800'000'000;
const UserName kAnn{"ann"}, kBob{"bob"};

Accounts withAnn() {
    Accounts accounts;
    EXPECT_TRUE(accounts.add(kAnn, Role::Editor));
    return accounts;
}

TEST(Accounts, AC2AnInvitationIsUsedOnceAndEnds) {
    Accounts accounts = withAnn();
    const std::string code = accounts.invite(kAnn, kNow).value();
    EXPECT_FALSE(accounts.join(code, kNow + Accounts::kInvitationSeconds));
    const auto joined = accounts.join(code, kNow + Accounts::kInvitationSeconds - 1);
    ASSERT_TRUE(joined);
    EXPECT_EQ(joined->user, kAnn);
    const auto again = accounts.join(code, kNow);
    ASSERT_FALSE(again);
    EXPECT_EQ(again.error().code, ErrorCode::SignInRequired);
    ASSERT_TRUE(accounts.find(joined->token));
    EXPECT_EQ(accounts.find(joined->token)->user, kAnn);
    EXPECT_FALSE(accounts.find(code));
    EXPECT_FALSE(accounts.find(""));
}

TEST(Accounts, AC2TheFileHasNoSecret) {
    Accounts accounts = withAnn();
    const std::string code = accounts.invite(kAnn, kNow).value();
    EXPECT_EQ(accounts.text().find(code), std::string::npos);
    const auto joined = accounts.join(code, kNow).value();
    EXPECT_EQ(joined.token.size(), 64u);
    EXPECT_EQ(accounts.text().find(joined.token), std::string::npos);
}

TEST(Accounts, AC3RolesOfProjects) {
    Accounts accounts = withAnn();
    const auto joined = accounts.join(accounts.invite(kAnn, kNow).value(), kNow).value();
    const std::string token = accounts.find(joined.token)->token;
    ASSERT_TRUE(accounts.setRole(kAnn, Role::None, "secret"));
    EXPECT_EQ(accounts.roleOf(kAnn, token, "secret"), Role::None);
    EXPECT_EQ(accounts.roleOf(kAnn, token, "other"), Role::Editor);
    EXPECT_EQ(accounts.roleOf(kAnn, "other", "other"), Role::None);
    EXPECT_EQ(accounts.revoke(token).value(), kAnn);
    EXPECT_EQ(accounts.roleOf(kAnn, token, "other"), Role::None);
    EXPECT_FALSE(accounts.find(joined.token));
}

TEST(Accounts, ReadsBackWhatItWrites) {
    Accounts accounts = withAnn();
    ASSERT_TRUE(accounts.add(kBob, Role::Viewer));
    ASSERT_TRUE(accounts.setRole(kBob, Role::Admin, "a project"));
    (void)accounts.join(accounts.invite(kAnn, kNow).value(), kNow);
    (void)accounts.invite(kBob, kNow);
    const auto read = Accounts::parse(accounts.text());
    ASSERT_TRUE(read) << read.error().message;
    EXPECT_EQ(read->text(), accounts.text());
}

TEST(Accounts, MisuseIsNamed) {
    Accounts accounts = withAnn();
    EXPECT_NE(accounts.add(kAnn, Role::Viewer).error().message.find("already"), std::string::npos);
    EXPECT_NE(accounts.remove(kBob).error().message.find("bob"), std::string::npos);
    EXPECT_NE(accounts.revoke("12345678").error().message.find("12345678"), std::string::npos);
    for (const char* name : {"", "a b", "a/b", "\n"})
        EXPECT_FALSE(accounts.add({name}, Role::Viewer)) << name;
    EXPECT_FALSE(accounts.add({std::string(65, 'a')}, Role::Viewer));
}

TEST(Accounts, BadFilesAreNamed) {
    const auto problem = [](const std::string& text) {
        const auto parsed = Accounts::parse(text);
        return parsed ? "" : parsed.error().message;
    };
    EXPECT_NE(problem("{\n\n").find("line 3"), std::string::npos);
    EXPECT_NE(problem(R"({"format": 2, "version": 1, "users": {}})").find("newer"),
              std::string::npos);
    EXPECT_NE(problem(R"({"format": 1, "version": 1, "users": {"ann": {"role": "boss"}}})")
                  .find("the role of the user ann"),
              std::string::npos);
    EXPECT_NE(problem(R"({"format": 1, "version": 1, "users": {"ann": {"role": "viewer",
              "tokens": [{"hash": "x", "madeAt": 1}], "invitations": []}}})")
                  .find("a token of the user ann"),
              std::string::npos);
    for (const char* text :
         {"", "20E10009", "[]", "{}", R"({"format": 1})", R"({"format": 1, "version": -1})",
          R"({"format": 1, "version": 1, "users": []})"})
        EXPECT_FALSE(problem(text).empty()) << text;
}

class AccountsFileTest : public ::testing::Test {
protected:
    void SetUp() override {
        std::string name = fs::temp_directory_path() / "accountsXXXXXX";
        folder = ::mkdtemp(name.data());
    }
    void TearDown() override { fs::remove_all(folder); }

    fs::path folder;
};

TEST_F(AccountsFileTest, NobodyElseReadsIt) {
    const AccountsFile file(folder);
    EXPECT_FALSE(file.read().value());
    ASSERT_TRUE(file.change([](Accounts& all) { return all.add(kAnn, Role::Editor); }));
    struct stat found{};
    ASSERT_EQ(::stat(file.path().c_str(), &found), 0);
    EXPECT_EQ(found.st_mode & 0777, 0600u);
    ASSERT_EQ(::chmod(file.path().c_str(), 0640), 0);
    const auto read = file.read();
    ASSERT_FALSE(read);
    EXPECT_NE(read.error().message.find("chmod 600"), std::string::npos);
}

TEST_F(AccountsFileTest, ConcurrentChangesAllArrive) {
    const AccountsFile file(folder);
    std::vector<std::thread> threads;
    for (int thread = 0; thread < 4; ++thread)
        threads.emplace_back([&, thread] {
            for (int index = 0; index < 10; ++index)
                EXPECT_TRUE(file.change([&](Accounts& all) {
                    return all.add({"u" + std::to_string(thread) + "-" + std::to_string(index)},
                                   Role::Viewer);
                }));
        });
    for (std::thread& thread : threads) thread.join();
    const auto read = file.read().value();
    ASSERT_TRUE(read);
    EXPECT_EQ(read->users().size(), 40u);
    EXPECT_EQ(read->version(), 40u);
}

TEST_F(AccountsFileTest, AFailedChangeLeavesTheFile) {
    const AccountsFile file(folder);
    ASSERT_TRUE(file.change([](Accounts& all) { return all.add(kAnn, Role::Editor); }));
    const auto stamp = file.stamp();
    EXPECT_FALSE(file.change([](Accounts& all) { return all.add(kAnn, Role::Editor); }));
    EXPECT_EQ(file.stamp(), stamp);
}

TEST_F(AccountsFileTest, AC5RefusalsSlowDownAnAddress) {
    SignIn signIn(folder);
    ASSERT_TRUE(signIn.start());
    EXPECT_FALSE(signIn.isRequired());
    const auto now = std::chrono::steady_clock::now();
    const auto ms = [&](const char* address, std::chrono::seconds later = {}) {
        return signIn.refused(address, now + later).count();
    };
    EXPECT_EQ(ms("a"), 100);
    EXPECT_EQ(ms("a"), 200);
    EXPECT_EQ(ms("b"), 100);
    for (int guess = 0; guess < 20; ++guess) (void)ms("a");
    EXPECT_EQ(ms("a"), 5'000);
    EXPECT_EQ(ms("a", std::chrono::minutes(2)), 100);
    EXPECT_EQ(signIn.refusals(), 25u);
}

TEST(Accounts, AC12AServiceAccountHasTokensAndNoInvitations) {
    Accounts accounts;
    ASSERT_TRUE(accounts.add({"farm"}, Role::Viewer, true));
    ASSERT_TRUE(accounts.add(kAnn, Role::Editor));
    EXPECT_FALSE(accounts.invite({"farm"}, 100));
    EXPECT_FALSE(accounts.makeToken(kAnn, 100, {}));
    const auto forever = accounts.makeToken({"farm"}, 100, {});
    const auto ends = accounts.makeToken({"farm"}, 100, 200);
    ASSERT_TRUE(forever && ends);
    EXPECT_FALSE(accounts.find(*forever)->endsAt);
    const auto again = Accounts::parse(accounts.text());
    ASSERT_TRUE(again) << again.error().message;
    EXPECT_EQ(again->text(), accounts.text());
    EXPECT_TRUE(again->users().at({"farm"}).isService);
    EXPECT_EQ(again->find(*ends)->endsAt, 200);
    EXPECT_FALSE(again->users().at(kAnn).isService);
    // A new token takes the place of those that have ended.
    ASSERT_TRUE(accounts.makeToken({"farm"}, 200, {}));
    EXPECT_EQ(accounts.users().at({"farm"}).tokens.size(), 2u);
    EXPECT_FALSE(accounts.find(*ends));
    EXPECT_TRUE(accounts.find(*forever));
    ASSERT_TRUE(accounts.revoke(accounts.find(*forever)->token));
    EXPECT_FALSE(accounts.find(*forever));
}

}  // namespace
}  // namespace usdlive::server
