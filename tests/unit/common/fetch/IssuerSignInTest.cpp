// Tests what a program asks an issuer for, and when (AC26).
#include "usdlive/common/fetch/IssuerSignIn.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdlib>
#include <ctime>
#include <filesystem>

#include "unit/common/fetch/PreparedServer.h"
#include "usdlive/common/fetch/Issuer.h"
#include "usdlive/common/net/KnownServers.h"

namespace usdlive::fetch {
namespace {

using testing::HasSubstr;

constexpr const char* kHost = "render.example";
constexpr std::uint16_t kPort = 7447;
// Its claims are {"exp":4102444800}.
constexpr const char* kNewToken = "e30.eyJleHAiOjQxMDI0NDQ4MDB9.AA";

TEST(ServiceUrl, IsEncryptedOrOfThisMachine) {
    const auto url = parseServiceUrl("https://ID.example/realms/film?x=1");
    ASSERT_TRUE(url);
    EXPECT_EQ(*url, (ServiceUrl{{"id.example", 443, true}, "/realms/film?x=1"}));
    EXPECT_EQ(parseServiceUrl("https://id.example:8443")->target, "/");
    EXPECT_EQ(parseServiceUrl("https://id.example?x")->target, "/?x");
    EXPECT_EQ(parseServiceUrl("http://127.0.0.1:80/a")->origin, (Origin{"127.0.0.1", 80, false}));
    EXPECT_TRUE(parseServiceUrl("http://localhost/"));
    for (const char* wrong :
         {"", "id.example", "http://id.example/", "http://127.0.0.1.example/", "ftp://id.example",
          "https://", "https:///a", "https://a@id.example/", "https://id.example/#a",
          "https://id.example/a b", "https://id.example/\x1b[31m", "https://id.example:0/",
          "https://id.example/\xc3\xa4", "https://id.example\\@evil.example/",
          "HTTPS://id.example"})
        EXPECT_FALSE(parseServiceUrl(wrong)) << wrong;
    EXPECT_FALSE(parseServiceUrl("https://id.example/" + std::string(3'000, 'a')));
}

class IssuerTest : public testing::Test {
protected:
    IssuerTest() {
        std::filesystem::remove_all(folder_);
        ::setenv("XDG_CONFIG_HOME", folder_.c_str(), 1);
    }
    ~IssuerTest() override {
        ::unsetenv("XDG_CONFIG_HOME");
        std::filesystem::remove_all(folder_);
    }

    /// Keeps a token that ends after some seconds.
    static void keep(const std::string& tokensUrl, std::int64_t seconds, bool isTls = true) {
        const TokenRenewal renewal{tokensUrl, "usdlive", "refresh&1", std::time(nullptr) + seconds};
        ASSERT_TRUE(KnownServers().keep(kHost, kPort, {"ann", "old", "", isTls, renewal}));
    }
    static std::string answer(const std::string& body, const char* status = "200 OK") {
        return std::string("HTTP/1.1 ") + status +
               "\r\nContent-Length: " + std::to_string(body.size()) + "\r\n\r\n" + body;
    }
    static KnownServer entry() { return **KnownServers().find(kHost, kPort); }

    const std::filesystem::path folder_ =
        std::filesystem::temp_directory_path() / ("issuer" + std::to_string(::getpid()));
};

TEST_F(IssuerTest, AFreshTokenIsSentAsItIs) {
    keep("http://127.0.0.1:1/", 31);
    EXPECT_EQ(*authorizationFor(kHost, kPort, true).value(), "Bearer old");
    EXPECT_FALSE(authorizationFor(kHost, kPort, false).value());
    EXPECT_FALSE(authorizationFor("other.example", kPort, true).value());
}

TEST_F(IssuerTest, ATokenThatEndsIsRenewed) {
    Prepared issuer({{answer(std::string(R"({"id_token":")") + kNewToken +
                             R"(","refresh_token":"refresh2"})")}});
    keep(issuer.origin.url() + "/token", 29);
    EXPECT_EQ(*authorizationFor(kHost, kPort, true).value(), std::string("Bearer ") + kNewToken);
    ASSERT_EQ(issuer.requests().size(), 1u);
    EXPECT_THAT(issuer.requests().front(),
                HasSubstr("grant_type=refresh_token&refresh_token=refresh%261&client_id=usdlive"));
    EXPECT_EQ(entry().token, kNewToken);
    EXPECT_EQ(entry().renewal->refreshToken, "refresh2");
    EXPECT_EQ(entry().renewal->endsAt, 4102444800);
    EXPECT_EQ(*authorizationFor(kHost, kPort, true).value(), std::string("Bearer ") + kNewToken);
}

TEST_F(IssuerTest, AnIssuerMayKeepTheRefreshToken) {
    Prepared issuer({{answer(std::string(R"({"id_token":")") + kNewToken + R"("})")}});
    keep(issuer.origin.url() + "/token", -100);
    EXPECT_TRUE(*authorizationFor(kHost, kPort, true));
    EXPECT_EQ(entry().renewal->refreshToken, "refresh&1");
}

TEST_F(IssuerTest, ARefusalIsFinalAndSaysWhatToDo) {
    Prepared issuer({{answer(R"({"error":"invalid_grant"})", "400 Bad Request")}});
    keep(issuer.origin.url() + "/token", -1);
    for (int times = 0; times < 2; ++times) {  // the second time nobody is asked
        const auto refused = authorizationFor(kHost, kPort, true);
        ASSERT_FALSE(refused);
        EXPECT_EQ(refused.error().code, ErrorCode::SignInRequired);
        EXPECT_THAT(refused.error().message, HasSubstr("usdlive login render.example:7447"));
        EXPECT_THAT(refused.error().message, Not(HasSubstr("refresh&1")));
        EXPECT_EQ(entry().renewal->refreshToken, "");
    }
    EXPECT_EQ(issuer.requests().size(), 1u);
}

TEST_F(IssuerTest, AnIssuerThatIsDownIsAskedAgain) {
    keep("http://127.0.0.1:1/token", 5);
    EXPECT_EQ(*authorizationFor(kHost, kPort, true).value(), "Bearer old");
    keep("http://127.0.0.1:1/token", -5);
    EXPECT_THAT(authorizationFor(kHost, kPort, true).error().message, HasSubstr("usdlive login"));
    EXPECT_EQ(entry().renewal->refreshToken, "refresh&1");
    Prepared broken({{answer("<html>", "502 Bad Gateway")}, {answer(R"({"id_token":"a.b.c"})")}});
    keep(broken.origin.url() + "/token", -5);
    EXPECT_FALSE(authorizationFor(kHost, kPort, true));
    EXPECT_FALSE(authorizationFor(kHost, kPort, true));  // a token without an end
    EXPECT_EQ(entry().renewal->refreshToken, "refresh&1");
}

TEST_F(IssuerTest, NothingIsSentToAnAddressThatOthersCanRead) {
    keep("http://id.example/token", -5);
    EXPECT_THAT(authorizationFor(kHost, kPort, true).error().message, HasSubstr("not encrypted"));
    const auto plain = login("render.example", kPort, false, [](const DevicePrompt&) {});
    ASSERT_FALSE(plain);
    EXPECT_THAT(plain.error().message, HasSubstr("wss://render.example:7447"));
}

TEST_F(IssuerTest, AStopEndsTheWait) {
    Prepared silent({{""}});
    keep(silent.origin.url() + "/token", -5);
    const auto begin = std::chrono::steady_clock::now();
    EXPECT_FALSE(authorizationFor(kHost, kPort, true, [] { return true; }));
    EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(3));
}

TEST_F(IssuerTest, OneProgramRenewsAtATime) {
    const KnownServers known;
    auto first = known.lockRenewal(std::chrono::milliseconds(100)).value();
    ASSERT_TRUE(first);
    EXPECT_FALSE(known.lockRenewal(std::chrono::milliseconds(50)).value());
    EXPECT_FALSE(known.lockRenewal(std::chrono::hours(1), [] { return true; }).value());
    first.reset();
    EXPECT_TRUE(known.lockRenewal(std::chrono::milliseconds(0)).value());
}

TEST_F(IssuerTest, ADocumentNamesItsIssuer) {
    Prepared other({{answer(R"({"issuer":"https://other.example","jwks_uri":"https://a/",)"
                            R"("token_endpoint":"https://a/"})")},
                    {answer("[]")},
                    {answer("", "404 Not Found")}});
    EXPECT_THAT(discover(other.origin.url()).error().cause, HasSubstr("another issuer"));
    EXPECT_THAT(discover(other.origin.url()).error().cause, HasSubstr("not JSON"));
    EXPECT_THAT(discover(other.origin.url() + "/realm/").error().cause, HasSubstr("HTTP 404"));
    EXPECT_THAT(other.requests().back(),
                HasSubstr("GET /realm/.well-known/openid-configuration HTTP"));
    EXPECT_FALSE(discover("http://id.example"));
}

}  // namespace
}  // namespace usdlive::fetch
