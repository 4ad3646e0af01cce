// Tests who a request comes from, by tokens of this server and of an issuer (AC20, AC22).
#include "auth/SignIn.h"

#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "unit/server/auth/TestIssuer.h"

namespace usdlive::server {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;
using Why = Stranger::Why;

constexpr std::int64_t kToday = 1'800'000'000;

class SignInTest : public testing::Test {
protected:
    SignInTest() { fs::create_directories(folder_); }
    ~SignInTest() override { fs::remove_all(folder_); }

    static const TestKey& key() {
        static const TestKey made = TestKey::edwards("one");
        return made;
    }
    static IssuerSettings issuer(Role role) {
        return {{"https://id.example", "usdlive", "sub"}, role, "usdlive", "openid", {}};
    }
    static std::string token(const std::string& user) {
        return key().sign({{"iss", "https://id.example"},
                           {"aud", "usdlive"},
                           {"sub", user},
                           {"exp", kToday + 60},
                           {"groups", {"lighting"}}});
    }
    static void giveKeys(SignIn& signIn) {
        signIn.setIssuerKeys(
            IssuerKeys::parse(Json{{"keys", Json::array({key().published()})}}.dump()).value());
    }
    static std::optional<Stranger> stranger(const SignIn& signIn, const std::string& token) {
        const auto found = signIn.find("Bearer " + token, kToday);
        return found ? std::nullopt : std::optional(found.error());
    }
    /// Adds a user with an account, and returns a token of this server.
    std::string addAnn(Role role) const {
        std::string code;
        const AccountsFile file(folder_);
        EXPECT_TRUE(file.change([&](Accounts& accounts) {
            EXPECT_TRUE(accounts.add({"ann"}, role));
            return accounts.invite({"ann"}, kToday).map([&](std::string made) { code = made; });
        }));
        std::string own;
        EXPECT_TRUE(file.change([&](Accounts& accounts) {
            return accounts.join(code, kToday).map([&](const Accounts::Joined& joined) {
                own = joined.token;
            });
        }));
        return own;
    }

    const fs::path folder_ = fs::temp_directory_path() / ("signin" + std::to_string(::getpid()));
};

TEST_F(SignInTest, AC20AnIssuerAsksUsersToSignIn) {
    SignIn open(folder_);
    ASSERT_TRUE(open.start());
    EXPECT_FALSE(open.isRequired());
    SignIn signIn(folder_, issuer(Role::Viewer));
    ASSERT_TRUE(signIn.start());
    EXPECT_TRUE(signIn.isRequired());
    EXPECT_EQ(stranger(signIn, token("eve"))->why, Why::NoKeys);
    giveKeys(signIn);
    EXPECT_FALSE(stranger(signIn, token("eve")));
    EXPECT_EQ(signIn.find("", kToday).error().why, Why::NoToken);
    EXPECT_EQ(signIn.find(token("eve"), kToday).error().why, Why::UnknownToken);
    EXPECT_EQ(signIn.find("Basic " + token("eve"), kToday).error().why, Why::UnknownToken);
    EXPECT_EQ(stranger(signIn, std::string(64, 'a'))->why, Why::UnknownToken);
    const auto late = signIn.find("Bearer " + token("eve"), kToday + 60);
    EXPECT_EQ(late.error().problem, TokenProblem::Expired);
    signIn.setIssuerKeys(std::nullopt);
    EXPECT_EQ(stranger(signIn, token("eve"))->why, Why::NoKeys);
}

TEST_F(SignInTest, AC12TheTokenOfAServiceAccountEnds) {
    std::string own;
    ASSERT_TRUE(AccountsFile(folder_).change([&](Accounts& accounts) {
        EXPECT_TRUE(accounts.add({"farm"}, Role::Viewer, true));
        return accounts.makeToken({"farm"}, kToday, kToday + 60).map([&](std::string made) {
            own = std::move(made);
        });
    }));
    SignIn signIn(folder_, issuer(Role::Viewer));
    ASSERT_TRUE(signIn.start());
    giveKeys(signIn);
    const auto at = [&](std::int64_t now) { return signIn.find("Bearer " + own, now); };
    ASSERT_TRUE(at(kToday + 59));
    EXPECT_EQ(at(kToday + 59)->end(), kToday + 60);
    ASSERT_FALSE(at(kToday + 60));
    EXPECT_EQ(at(kToday + 60).error().why, Why::EndedToken);
    // Nobody signs in at the issuer as a program.
    EXPECT_EQ(stranger(signIn, token("farm"))->why, Why::IsService);
}

TEST_F(SignInTest, AC20WithoutAnIssuerAJwtIsAnUnknownToken) {
    (void)addAnn(Role::Editor);
    SignIn signIn(folder_);
    ASSERT_TRUE(signIn.start());
    giveKeys(signIn);
    EXPECT_EQ(stranger(signIn, token("ann"))->why, Why::UnknownToken);
}

TEST_F(SignInTest, AC22TheRoleIsThatOfTheAccountElseOfTheOption) {
    const std::string own = addAnn(Role::Editor);
    SignIn signIn(folder_, issuer(Role::Viewer));
    ASSERT_TRUE(signIn.start());
    giveKeys(signIn);
    const auto roleOf = [&](const std::string& shown) {
        const auto found = signIn.find("Bearer " + shown, kToday).value();
        return SignIn::in(*signIn.accounts(), found, "shot").role;
    };
    EXPECT_EQ(roleOf(token("ann")), Role::Editor);
    EXPECT_EQ(roleOf(token("eve")), Role::Viewer);
    EXPECT_EQ(roleOf(own), Role::Editor);
    // A user named as the owner's token is called is still a user.
    EXPECT_EQ(roleOf(token("owner")), Role::Viewer);
    const auto ann = signIn.find("Bearer " + token("ann"), kToday).value();
    EXPECT_EQ(ann.issued->groups, std::set<std::string>{"lighting"});
    EXPECT_EQ(ann.issued->endsAt, kToday + 60);
    EXPECT_EQ(ann.token.find(token("ann")), std::string::npos);
    EXPECT_FALSE(signIn.find("Bearer " + own, kToday)->issued);
    // The account is removed: the token of the issuer gives what it gives to anybody.
    Accounts accounts = *signIn.accounts();
    ASSERT_TRUE(accounts.remove({"ann"}));
    EXPECT_EQ(SignIn::in(accounts, ann, "shot").role, Role::Viewer);
    ASSERT_TRUE(accounts.add({"ann"}, Role::Admin));
    ASSERT_TRUE(accounts.setRole({"ann"}, Role::None, "secret"));
    EXPECT_EQ(SignIn::in(accounts, ann, "secret").role, Role::None);
    EXPECT_EQ(SignIn::in(accounts, ann, "shot").role, Role::Admin);
}

TEST_F(SignInTest, AC22WithoutARoleOnlyUsersWithAnAccountGetIn) {
    (void)addAnn(Role::Editor);
    SignIn signIn(folder_, issuer(Role::None));
    ASSERT_TRUE(signIn.start());
    giveKeys(signIn);
    EXPECT_FALSE(stranger(signIn, token("ann")));
    const auto eve = stranger(signIn, token("eve"));
    ASSERT_TRUE(eve);
    EXPECT_EQ(eve->why, Why::NoRole);
    EXPECT_EQ(eve->user, UserName{"eve"});
}

}  // namespace
}  // namespace usdlive::server
