// Tests the parsing of server addresses.
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <map>

#include "transport/Connection.h"
#include "transport/LiveSessions.h"
#include "usdlive/common/net/KnownServers.h"

using namespace usdlive;
using client::liveSessionAddress;
using client::mainLineAddress;
using client::parseServerAddress;

TEST(ServerAddress, ReadsHostPortAndLayer) {
    const auto address = parseServerAddress("ws://studio:9000/shot/anim.usda");
    ASSERT_TRUE(address);
    EXPECT_EQ(address->host, "studio");
    EXPECT_EQ(address->port, 9000);
    EXPECT_EQ(address->layer, "shot/anim.usda");
    EXPECT_EQ(address->url(), "ws://studio:9000/shot/anim.usda");
}

TEST(ServerAddress, HasADefaultPortAndNoLayer) {
    for (const std::string text :
         {"ws://127.0.0.1", "usdlive://127.0.0.1/", "ws://127.0.0.1:7447/", "127.0.0.1:7447"}) {
        const auto address = parseServerAddress(text);
        ASSERT_TRUE(address) << text;
        EXPECT_EQ(address->port, 7447);
        EXPECT_EQ(address->layer, "");
        EXPECT_EQ(address->url(), "ws://127.0.0.1:7447");
    }
}

TEST(ServerAddress, ReadsIpv6) {
    for (const std::string text : {"ws://[::1]:80/a.usd", "usdlive://%5B::1%5D:80/a.usd"}) {
        const auto address = parseServerAddress(text);
        ASSERT_TRUE(address) << text;
        EXPECT_EQ(address->host, "::1");
        EXPECT_EQ(address->url(), "ws://[::1]:80/a.usd");
    }
}

TEST(ServerAddress, ReadsAddressesAsPeopleWriteThem) {
    for (const std::string text : {"WS://h/A.usda", "Ws://H:7447/A.usda", "USDLIVE://h/A.usda",
                                   "H/A.usda", " ws://h/A.usda\n"}) {
        const auto address = parseServerAddress(text);
        ASSERT_TRUE(address) << text;
        EXPECT_EQ(address->url(), "ws://h:7447/A.usda") << text;
    }
    EXPECT_EQ(parseServerAddress("DDS://Shots")->url(), "dds://Shots");
}

TEST(ServerAddress, DecodesPercentsBothWays) {
    const auto address = parseServerAddress("ws://h/my%20shot/100%25.usda");
    ASSERT_TRUE(address);
    EXPECT_EQ(address->layer, "my shot/100%.usda");
    EXPECT_EQ(address->url(), "ws://h:7447/my%20shot/100%25.usda");
}

TEST(ServerAddress, ReadsProjectsOverDds) {
    const auto all = parseServerAddress("dds://");
    ASSERT_TRUE(all);
    EXPECT_TRUE(all->dds && all->project.empty());
    const auto layer = parseServerAddress("dds://my%20shot/sets/a.usda");
    ASSERT_TRUE(layer);
    EXPECT_TRUE(layer->dds);
    EXPECT_EQ(layer->project, "my shot");
    EXPECT_EQ(layer->layer, "sets/a.usda");
    EXPECT_EQ(layer->url(), "dds://my%20shot/sets/a.usda");
    EXPECT_FALSE(parseServerAddress("ws://h")->dds);
}

TEST(ServerAddress, LV1ReadsLiveSessions) {
    struct Case {
        std::string text, project, layer;
    };
    for (const auto& [text, project, layer] :
         {Case{"ws://h:7447?session=dusk", "?session=dusk", ""},
          Case{"ws://h:7447/shots?session=dusk", "shots?session=dusk", ""},
          Case{"ws://h:7447/shot.usda?session=a%20b", "?session=a b", "shot.usda"},
          Case{"dds://shots?session=dusk", "shots?session=dusk", ""},
          Case{"dds://shots/shot.usda?session=100%25", "shots?session=100%", "shot.usda"}}) {
        const auto address = parseServerAddress(text);
        ASSERT_TRUE(address) << text;
        EXPECT_EQ(address->project, project);
        EXPECT_EQ(address->layer, layer);
        EXPECT_EQ(address->url(), text);
        EXPECT_EQ(mainLineAddress(*address).url(), text.substr(0, text.find('?')));
        EXPECT_EQ(liveSessionAddress(*address, "dawn").url(),
                  text.substr(0, text.find('?')) + "?session=dawn");
    }
    for (const std::string text : {"ws://h?session=", "ws://h?session=%2", "ws://h/%3Fsession%3D"})
        EXPECT_FALSE(parseServerAddress(text)) << text;
}

TEST(ServerAddress, ReadsProjectsOfAServer) {
    for (const std::string text : {"ws://h/my%20shot", "ws://h/my%20shot/"}) {
        const auto address = parseServerAddress(text);
        ASSERT_TRUE(address) << text;
        EXPECT_EQ(address->project, "my shot");
        EXPECT_EQ(address->layer, "");
        EXPECT_EQ(address->url(), "ws://h:7447/my%20shot");
    }
    client::ServerAddress both{"h", 7447, "sets/a.usda", "my shot"};
    EXPECT_EQ(both.url(), "ws://h:7447/my%20shot/sets/a.usda");
}

TEST(ServerAddress, ReportsErrors) {
    for (const std::string text : {"",
                                   "http://h",
                                   "ws://",
                                   "ws://:7447",
                                   "ws://h:",
                                   "ws://h:0",
                                   "ws://h:65536",
                                   "ws://h:12x",
                                   "ws://[::1",
                                   "ws://[::1]7",
                                   "ws://a b/",
                                   "ws://u@h/",
                                   "ws://h/../a.usda",
                                   "ws://h//a.usda",
                                   "ws://h/a/notes.txt",
                                   "ws://h/..",
                                   "ws://h/%zz.usda",
                                   "ws://h/a%2",
                                   "dds:///a.usda",
                                   "dds://p/../a.usda",
                                   "dds://%zz"}) {
        const auto address = parseServerAddress(text);
        ASSERT_FALSE(address) << text;
        EXPECT_EQ(address.error().code, ErrorCode::InvalidArgument) << text;
        EXPECT_NE(address.error().message.find("ws://HOST:PORT"), std::string::npos);
        EXPECT_EQ(address.error().message.find('\n'), std::string::npos);
    }
}

TEST(ServerAddress, EN5ReadsWhetherTheConnectionIsEncrypted) {
    const auto folder =
        std::filesystem::temp_directory_path() / ("addresses" + std::to_string(::getpid()));
    ::setenv("XDG_CONFIG_HOME", folder.c_str(), 1);
    ASSERT_TRUE(KnownServers().keep("studio", 9000, {"", "", "sha256:00", true}));
    for (const auto& [text, url] : std::map<std::string, std::string>{
             {"wss://studio/a.usda", "wss://studio:7447/a.usda"},
             {"WSS://Other:1", "wss://other:1"},
             {"ws://studio:9000", "ws://studio:9000"},
             {"usdlive://studio:9000/a.usda", "wss://studio:9000/a.usda"},
             {"Studio:9000", "wss://studio:9000"},
             {"studio:9001", "ws://studio:9001"}}) {
        const auto address = parseServerAddress(text);
        ASSERT_TRUE(address) << text;
        EXPECT_EQ(address->url(), url) << text;
    }
    ::unsetenv("XDG_CONFIG_HOME");
    std::filesystem::remove_all(folder);
}
