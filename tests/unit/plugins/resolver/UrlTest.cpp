// Tests addresses of files in served projects.
#include "Url.h"

#include <gtest/gtest.h>

using namespace usdlive::resolver;

namespace {

std::string identifierOf(std::string_view text) {
    const auto url = parseUrl(text);
    return url ? url->identifier() : "none";
}

std::string anchoredAt(std::string_view anchor, std::string_view path) {
    return anchored(*parseUrl(anchor), path).identifier();
}

std::string whyNot(std::string_view text) {
    std::string why;
    EXPECT_FALSE(parseUrl(text, &why)) << text;
    return why;
}

}  // namespace

TEST(Url, HasOneIdentifier) {
    for (const char* text :
         {"usdlive://localhost:7447/a/shot.usda", "usdlive://localhost/a/shot.usda",
          "USDLIVE://LocalHost:7447/a/./b/../shot.usda", "usdlive://localhost:7447//a/shot%2eusda"})
        EXPECT_EQ(identifierOf(text), "usdlive://localhost:7447/a/shot.usda") << text;
    EXPECT_EQ(identifierOf("usdlive://localhost:7447"), "usdlive://localhost:7447/");
    EXPECT_EQ(identifierOf("usdlive://h/tex.<UDIM>.png"), "usdlive://h:7447/tex.<UDIM>.png");
    EXPECT_EQ(identifierOf("usdlive://h/my brick.png"), "usdlive://h:7447/my brick.png");
}

// OpenUSD reads brackets as the path of a file in a package, so no text of ours has them.
TEST(Url, AHostMayBeAnIpv6Address) {
    for (const char* text :
         {"usdlive://[::1]/a.usdz", "usdlive://[::1]:7447/a.usdz",
          "usdlive://[0:0:0:0:0:0:0:1]/a.usdz", "usdlive://%5B::1%5D:7447/a.usdz"})
        EXPECT_EQ(identifierOf(text), "usdlive://%5B::1%5D:7447/a.usdz") << text;
    EXPECT_EQ(identifierOf("usdlive://[FE80::00A1]:8/"), "usdlive://%5Bfe80::a1%5D:8/");
    const auto url = parseUrl("usdlive://[::1]:8/@2/shot.usda");
    EXPECT_EQ(url->host, "::1");
    EXPECT_EQ(url->port, 8);
    EXPECT_EQ(parseUrl(url->identifier()), url);
    EXPECT_EQ(parseUrl(url->resolvedPath()), url);
}

TEST(Url, APinIsARevisionOrACheckpoint) {
    const auto revision = parseUrl("usdlive://h/a/shot.usda@1234");
    EXPECT_EQ(revision->path, "a/shot.usda");
    EXPECT_EQ(revision->pin, "1234");
    EXPECT_EQ(revision->identifier(), "usdlive://h:7447/a/shot.usda@1234");
    const auto checkpoint = parseUrl("usdlive://h/shot.usda@before lunch");
    EXPECT_EQ(checkpoint->pin, "before lunch");
    const auto dotted = parseUrl("usdlive://h/shot.usda@v1%2E2");
    EXPECT_EQ(dotted->pin, "v1.2");
    EXPECT_EQ(*parseUrl(dotted->identifier()), *dotted);
    EXPECT_EQ(*parseUrl(dotted->resolvedPath()), *dotted);
}

TEST(Url, AnAtSignInAFileNameIsNoPin) {
    EXPECT_EQ(parseUrl("usdlive://h/tex@2x.png")->path, "tex@2x.png");
    EXPECT_EQ(parseUrl("usdlive://h/tex@2x.png")->pin, "");
    EXPECT_EQ(parseUrl("usdlive://h/a@1/b.png")->path, "a@1/b.png");
    EXPECT_EQ(anchoredAt("usdlive://h/shot.usda", "./tex@2x"), "usdlive://h:7447/tex%402x");
    EXPECT_EQ(parseUrl("usdlive://h/tex%402x")->path, "tex@2x");
    EXPECT_EQ(anchoredAt("usdlive://h/shot.usda", "./@a/b.png"), "usdlive://h:7447/%40a/b.png");
    EXPECT_EQ(parseUrl("usdlive://h/%40a/b.png")->path, "@a/b.png");
}

TEST(Url, AResolvedPathEndsAsThePathDoes) {
    Url url = *parseUrl("usdlive://h/tex/a.usda@12");
    url.version = "12-abc";
    EXPECT_EQ(url.resolvedPath(), "usdlive://h:7447/@12~12-abc/tex/a.usda");
    EXPECT_EQ(*parseUrl(url.resolvedPath()), url);
    url.pin.clear();
    EXPECT_EQ(url.resolvedPath(), "usdlive://h:7447/@~12-abc/tex/a.usda");
    EXPECT_EQ(*parseUrl(url.resolvedPath()), url);
    url.version.clear();
    EXPECT_EQ(url.resolvedPath(), "usdlive://h:7447/tex/a.usda");
}

TEST(Url, RelativePathsAreFilesAsTheyAreWritten) {
    constexpr const char* kLayer = "usdlive://h/seq/shot.usda";
    EXPECT_EQ(anchoredAt(kLayer, "./a.png"), "usdlive://h:7447/seq/a.png");
    EXPECT_EQ(anchoredAt(kLayer, "../a.png"), "usdlive://h:7447/a.png");
    EXPECT_EQ(anchoredAt(kLayer, "a%20b.png"), "usdlive://h:7447/seq/a%2520b.png");
    EXPECT_EQ(parseUrl(anchoredAt(kLayer, "a%20b.png"))->path, "seq/a%20b.png");
    EXPECT_EQ(anchoredAt("usdlive://h/seq/shot.usda@12", "./a.png"),
              "usdlive://h:7447/seq/a.png@12");
    EXPECT_EQ(anchoredAt("usdlive://h/@12~12-ab/seq/shot.usda", "./a.png"),
              "usdlive://h:7447/seq/a.png@12");
    EXPECT_EQ(anchoredAt("usdlive://h/@~12-ab/seq/shot.usda", "./a.png"),
              "usdlive://h:7447/seq/a.png");
}

TEST(Url, APathWithSeveralAtSignsIsTheSameAddressWhenItIsReadAgain) {
    for (const char* path : {"@x@y", "a@b@c", "a@", "@@", "a@b.c@d", "a.b@c@d"}) {
        const auto url = anchored(*parseUrl("usdlive://h/dir/shot.usda"), path);
        EXPECT_EQ(parseUrl(url.identifier()), url) << path;
        EXPECT_EQ(parseUrl(url.resolvedPath()), url) << path;
    }
}

TEST(Url, APathMayLeadOutAndSaysSo) {
    EXPECT_TRUE(parseUrl("usdlive://h/../a.usda")->leadsOut());
    EXPECT_TRUE(parseUrl("usdlive://h/a/%2E%2E/..")->leadsOut());
    EXPECT_TRUE(anchored(*parseUrl("usdlive://h/shot.usda"), "../../x.usda").leadsOut());
    EXPECT_FALSE(parseUrl("usdlive://h/..a/b.usda")->leadsOut());
}

TEST(Url, OtherTextsAreRefusedWithAReason) {
    EXPECT_NE(whyNot("http://h/a.usda").find("usdlive://"), std::string::npos);
    EXPECT_NE(whyNot("usdlive:/a.usda").find("usdlive://"), std::string::npos);
    EXPECT_NE(whyNot("usdlive:///a.usda").find("host"), std::string::npos);
    EXPECT_NE(whyNot("usdlive://ada@h/a.usda").find("host"), std::string::npos);
    for (const char* host :
         {"[::1", "[]", "[::g]", "[::1]x", "::1", "[127.0.0.1]", "[fe80::1%25lo]"})
        EXPECT_NE(whyNot("usdlive://" + std::string(host) + ":1/a.usda").find("host"),
                  std::string::npos)
            << host;
    for (const char* text : {"usdlive://h:/a", "usdlive://h:0/a", "usdlive://h:65536/a",
                             "usdlive://h:1x/a", "usdlive://h:-1/a"})
        EXPECT_NE(whyNot(text).find("port"), std::string::npos) << text;
    EXPECT_NE(whyNot("usdlive://h/a%2").find('%'), std::string::npos);
    EXPECT_NE(whyNot("usdlive://h/a%00b").find('%'), std::string::npos);
    EXPECT_NE(whyNot("usdlive://h/@1/a.usda@2").find("two"), std::string::npos);
}
