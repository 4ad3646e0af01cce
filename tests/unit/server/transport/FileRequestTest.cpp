// Tests the parser of requests for a project's files (AS2).
#include "transport/FileRequest.h"

#include <gtest/gtest.h>

using namespace usdlive;
using namespace usdlive::server;

namespace {

const std::string kHashText(64, 'a');

ErrorCode codeOf(std::string_view path, std::string_view query = "") {
    const auto parsed = parseFileRequest(path, query);
    return parsed ? ErrorCode::Internal : parsed.error().code;
}

}  // namespace

TEST(FileRequest, AS1LayersMayBeLeftOut) {
    EXPECT_TRUE(parseFileRequest("", "")->layers);
    EXPECT_FALSE(parseFileRequest("", "layers=no")->layers);
    EXPECT_FALSE(parseFileRequest("", "layers=1"));
}

TEST(FileRequest, AS1WithoutAPathItAsksForTheList) {
    EXPECT_EQ(*parseFileRequest("", ""), FileRequest{});
    EXPECT_EQ(*parseFileRequest("/", "revision=12"), (FileRequest{"", {}, 12, {}}));
    EXPECT_EQ(*parseFileRequest("", "checkpoint=v%201&unknown=x"),
              (FileRequest{"", {}, {}, "v 1"}));
}

TEST(FileRequest, AS2DecodesThePath) {
    EXPECT_EQ(parseFileRequest("/tex/my%20brick%25.png", "")->path, "tex/my brick%.png");
    EXPECT_EQ(parseFileRequest("/tex%2Fa.png", "")->path, "tex/a.png");
    EXPECT_EQ(parseFileRequest("/\xC3\xA4.png", "")->path, "\xC3\xA4.png");
    EXPECT_EQ(parseFileRequest("/a.png", "hash=" + kHashText)->hash, hashFromHex(kHashText));
}

TEST(FileRequest, AS2RefusesPathsThatAreNotOfFilesInTheProject) {
    for (const std::string path :
         {"/..", "/../a", "/a/../b", "/a/./b", "/a//b", "//a", "/a/", "/.hidden", "/a/.usdlive/x",
          "/%2E%2E/a", "/a%2F..%2Fb", "/a%00b", "/a%2", "/a%zz", "/\xFF"})
        EXPECT_EQ(codeOf(path), ErrorCode::InvalidArgument) << path;
    EXPECT_EQ(codeOf("/" + std::string(4'097, 'a')), ErrorCode::InvalidArgument);
}

TEST(FileRequest, AS2RefusesMalformedQueries) {
    for (const std::string query : {"hash=abc", "hash=", "revision=", "revision=-1", "revision=1x",
                                    "revision=99999999999999999999", "checkpoint=",
                                    "checkpoint=%FF", "hash=%zz", "revision=1&checkpoint=a"})
        EXPECT_EQ(codeOf("/a.png", query), ErrorCode::InvalidArgument) << query;
    EXPECT_EQ(codeOf("", "checkpoint=" + std::string(201, 'a')), ErrorCode::InvalidArgument);
}
