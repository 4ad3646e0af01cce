// Tests requests over HTTP against a server that sends prepared bytes.
#include "usdlive/common/fetch/Http.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <zstd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <thread>

#include "unit/common/fetch/PreparedServer.h"
#include "usdlive/common/fetch/UsdliveServer.h"
#include "usdlive/common/net/KnownServers.h"

using namespace usdlive;
using namespace usdlive::fetch;
using namespace std::chrono_literals;
using testing::HasSubstr;

namespace {

const std::string kChunks =
    "HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n5\r\nhello\r\n6;a=b\r\n world\r\n"
    "0\r\nTrailer: x\r\n\r\n";

HttpLimits shortLimits() { return {200ms, 200ms, 200ms}; }

}  // namespace

TEST(Http, KeepsTheConnectionForTheNextRequest) {
    Prepared server({{ok("one"), kChunks, ok("three")}});
    HttpClient connection({});
    EXPECT_EQ(connection.get(server.request("/1")).value().body, "one");
    EXPECT_EQ(connection.get(server.request("/2")).value().body, "hello world");
    EXPECT_EQ(connection.get(server.request("/3")).value().body, "three");
    EXPECT_THAT(server.requests(),
                testing::ElementsAre(HasSubstr("/1"), HasSubstr("/2"), HasSubstr("/3")));
}

TEST(Http, AsksAgainOnlyIfAKeptConnectionWasClosed) {
    Prepared server({{ok("one")}, {ok("two"), "HTTP/1.1 2"}, {ok("never")}});
    HttpClient connection({});
    EXPECT_EQ(connection.get(server.request()).value().body, "one");
    EXPECT_EQ(connection.get(server.request()).value().body, "two");
    const auto begun = connection.get(server.request());
    ASSERT_FALSE(begun) << begun->body;
    EXPECT_THAT(begun.error().cause, HasSubstr("ended before the end"));
    EXPECT_EQ(server.requests().size(), 3U);
}

TEST(Http, ReadsBodiesOfAllKindsInPiecesOfAnySize) {
    for (const std::size_t piece : {std::size_t(1), std::size_t(7), std::string::npos}) {
        Prepared server({{kChunks, "HTTP/1.0 200 OK\r\nETag: \"abc\"\r\n\r\nto the end"}, {ok("")}},
                        piece);
        HttpClient connection({});
        EXPECT_EQ(connection.get(server.request()).value().body, "hello world");
        const auto answer = connection.get(server.request());
        EXPECT_EQ(answer.value().body, "to the end");
        EXPECT_EQ(answer->etag(), "abc");
        EXPECT_EQ(answer->header("etag"), "\"abc\"");
        EXPECT_EQ(connection.get(server.request()).value().body, "");
    }
}

TEST(Http, AS5InflatesABodyOfAnyKind) {
    const std::string text(100'000, 'x');
    std::string frame(ZSTD_compressBound(text.size()), '\0');
    frame.resize(ZSTD_compress(frame.data(), frame.size(), text.data(), text.size(), 1));
    Prepared server({{ok(frame, "Content-Encoding: zstd\r\n"),
                      "HTTP/1.1 200 OK\r\nContent-Encoding: zstd\r\n\r\n" + frame},
                     {ok(frame, "Content-Encoding: gzip\r\n")}});
    HttpClient connection({});
    HttpRequest request = server.request();
    request.takesZstd = true;
    EXPECT_EQ(connection.get(request).value().body, text);
    EXPECT_EQ(connection.get(request).value().body, text);
    EXPECT_THAT(server.requests()[0], HasSubstr("Accept-Encoding: zstd\r\n"));
    EXPECT_THAT(connection.get(request).error().cause, HasSubstr("unknown encoding gzip"));
}

TEST(Http, ACutBodyIsAFailure) {
    const std::string cut = ok("hello world");
    Prepared server({{cut.substr(0, cut.size() - 1)}, {kChunks.substr(0, kChunks.size() - 30)}});
    for (int count = 0; count < 2; ++count) {
        const auto answer = get(server.request(), {});
        ASSERT_FALSE(answer) << answer->body;
        EXPECT_EQ(answer.error().cause, "the connection ended before the end");
        EXPECT_FALSE(answer.error().isUnreachable);
    }
}

TEST(Http, ABodyHasABound) {
    HttpLimits limits;
    limits.bodyBytes = 10;
    Prepared server({{ok("0123456789")}, {ok("hello world")}, {kChunks}});
    EXPECT_EQ(get(server.request(), limits).value().body, "0123456789");
    for (int count = 0; count < 2; ++count)
        EXPECT_THAT(get(server.request(), limits).error().cause, HasSubstr("more than 10 bytes"));
}

TEST(Http, AnErrorOfTheServerIsAnAnswer) {
    const std::string large(100'000, 'x');
    Prepared server({{"HTTP/1.1 404 Not Found\r\nContent-Length: 5\r\n\r\nnone\n"},
                     {"HTTP/1.1 500 Error\r\nContent-Length: 100000\r\n\r\n" + large},
                     {"HTTP/1.1 500 Error\r\n\r\n" + large},
                     {"HTTP/1.1 304 Not Modified\r\nContent-Length: 5\r\n\r\n"}});
    const auto none = get(server.request(), {});
    EXPECT_EQ(none.value().status, 404U);
    EXPECT_EQ(none->body, "none\n");
    for (int count = 0; count < 2; ++count) {
        const auto failed = get(server.request(), {});
        EXPECT_EQ(failed.value().status, 500U);
        EXPECT_EQ(failed->body, "");
    }
    EXPECT_EQ(get(server.request(), {}).value().status, 304U);
}

TEST(Http, ASilentServerIsUnreachableInTime) {
    Prepared server({{""}, {"HTTP/1.1 200 OK\r\nContent-Length: 9\r\n\r\n", ""}, {""}});
    HttpLimits limits = shortLimits();
    const auto silent = get(server.request(), limits);
    EXPECT_EQ(silent.error().cause, "no answer: it did not respond in time");
    EXPECT_TRUE(silent.error().isUnreachable);
    limits.whole = 100ms;
    limits.answer = 1h;
    EXPECT_EQ(get(server.request(), limits).error().cause, "no complete answer within 100 ms");
    const auto late = get(server.request(), limits);
    EXPECT_EQ(late.error().cause, "no answer: no complete answer within 100 ms");
    EXPECT_TRUE(late.error().isUnreachable);
}

TEST(Http, ARefusedConnectionHasItsError) {
    Origin origin;
    {
        Prepared server({});
        origin = server.origin;
    }
    const auto answer = get({origin, "/"}, {});
    EXPECT_EQ(answer.error().error, ECONNREFUSED);
    EXPECT_EQ(answer.error().cause, "Connection refused");
    EXPECT_TRUE(answer.error().isUnreachable);
}

TEST(Http, SendsAForm) {
    Prepared server({{ok("yes")}});
    HttpRequest request = server.request("/form");
    request.isPost = true;
    request.form = formOf({{"a b", "1&2=3"}, {"c", ""}, {"d", "\n"}});
    EXPECT_EQ(get(request, {}).value().body, "yes");
    ASSERT_EQ(server.requests().size(), 1u);
    const std::string sent = server.requests().front();
    EXPECT_TRUE(sent.starts_with("POST /form HTTP/1.1\r\n")) << sent;
    EXPECT_THAT(sent, HasSubstr("\r\nContent-Type: application/x-www-form-urlencoded\r\n"));
    EXPECT_TRUE(sent.ends_with("\r\n\r\na%20b=1%262%3D3&c=&d=%0A")) << sent;
}

TEST(Http, StopsWhenItIsAsked) {
    Prepared server({{""}});
    std::atomic<int> asked = 0;
    const auto answer = get(server.request(), {}, [&] { return ++asked > 3; });
    ASSERT_FALSE(answer);
    EXPECT_EQ(answer.error().error, ECANCELED);
    EXPECT_LT(asked, 10);
}

TEST(Http, ALineBreakIsNoPartOfARequest) {
    Prepared server({{ok("never")}});
    HttpRequest request = server.request("/a HTTP/1.1\r\nX: y");
    EXPECT_THAT(get(request, {}).error().cause, HasSubstr("line break"));
    request = server.request();
    request.headers = {{"If-None-Match", "\"a\"\nX: y"}};
    EXPECT_THAT(get(request, {}).error().cause, HasSubstr("line break"));
    EXPECT_TRUE(server.requests().empty());
}

TEST(Origin, WritesItsUrl) {
    EXPECT_EQ((Origin{"localhost", 7447}.url()), "http://localhost:7447");
    EXPECT_EQ((Origin{"::1", 7447, true}.url()), "https://[::1]:7447");
    EXPECT_EQ((Origin{"a.example", 443, true}.hostAndPort()), "a.example");
    EXPECT_EQ((Origin{"a.example", 443}.hostAndPort()), "a.example:443");
}

TEST(Origin, IsParsed) {
    const auto parsed = [](std::string_view text) {
        const auto origin = parseOrigin(text, 80);
        return origin ? origin->host + " " + std::to_string(origin->port) : origin.error().cause;
    };
    EXPECT_EQ(parsed("A.Example"), "a.example 80");
    EXPECT_EQ(parsed("my_host-1:7447"), "my_host-1 7447");
    EXPECT_EQ(parsed("[0:0:0:0:0:0:0:1]"), "::1 80");
    EXPECT_EQ(parsed("[::1]:65535"), "::1 65535");
    for (const char* text :
         {"", ":80", "::1", "[::1", "[host]", "a b", "user@host", "a/b", "[::1]x"})
        EXPECT_EQ(parsed(text), "it names no host") << text;
    for (const char* text : {"a:", "a:0", "a:65536", "a:1x", "a:-1", "[::1]:"})
        EXPECT_EQ(parsed(text), "its port is not a number from 1 to 65535") << text;
}

namespace {

/// Keeps what this user knows about servers in a folder of its own.
class UsdliveServerTest : public testing::Test {
protected:
    UsdliveServerTest() {
        char name[] = "/tmp/usdlive-servers-XXXXXX";
        folder = ::mkdtemp(name);
        ::setenv("XDG_CONFIG_HOME", folder.c_str(), 1);
    }
    ~UsdliveServerTest() override {
        ::unsetenv("XDG_CONFIG_HOME");
        std::filesystem::remove_all(folder);
    }
    std::string folder;
};

}  // namespace

TEST_F(UsdliveServerTest, GetsTheTokenOfTheUser) {
    Prepared server({{ok("one")}});
    KnownServer known;
    known.token = "a-token";
    ASSERT_TRUE(KnownServers().keep(server.origin.host, server.origin.port, known));
    EXPECT_EQ(getFromServer(server.request(), {}).value().body, "one");
    EXPECT_THAT(server.requests()[0], HasSubstr("\r\nAuthorization: Bearer a-token\r\n"));
}

TEST_F(UsdliveServerTest, SaysWhatToDo) {
    Origin origin;
    {
        Prepared server({{"HTTP/1.1 401 Unauthorized\r\nContent-Length: 0\r\n\r\n"}});
        origin = server.origin;
        const auto refused = getFromServer(server.request(), {});
        EXPECT_EQ(refused.error().status, 401U);
        EXPECT_THAT(refused.error().cause, HasSubstr("`usdlive join INVITATION`"));
    }
    EXPECT_THAT(getFromServer({origin, "/"}, {}).error().cause, HasSubstr("usdlive serve"));
}
