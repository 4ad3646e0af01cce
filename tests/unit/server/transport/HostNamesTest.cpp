// Tests which hosts of requests are those of the server (HO1).
#include "transport/HostNames.h"

#include <gtest/gtest.h>

namespace usdlive::server {

namespace {

TEST(HostNames, TheHostOfAHeaderHasNoPort) {
    const std::vector<std::pair<std::string, std::optional<std::string>>> cases{
        {"localhost", "localhost"},
        {"localhost:7447", "localhost"},
        {"Workstation.Studio.LAN.:80", "workstation.studio.lan"},
        {"127.0.0.1:7447", "127.0.0.1"},
        {"[::1]:7447", "::1"},
        {"[::1]", "::1"},
        {"my_host:", "my_host"},
        {"", std::nullopt},
        {":7447", std::nullopt},
        {".", std::nullopt},
        {"::1", std::nullopt},
        {"[::1", std::nullopt},
        {"[::1]x", std::nullopt},
        {"[localhost]", std::nullopt},
        {"localhost:port", std::nullopt},
        {"localhost:123456", std::nullopt},
        {"localhost evil.example", std::nullopt},
        {"user@localhost", std::nullopt},
        {"localhost/path", std::nullopt},
        {"stra\xc3\x9f"
         "e.example",
         std::nullopt},
        {std::string("localhost\0.evil.example", 23), std::nullopt},
        {std::string(254, 'a'), std::nullopt},
    };
    for (const auto& [header, host] : cases) EXPECT_EQ(hostOf(header), host) << header;
}

TEST(HostNames, HO1AllowsTheServersNamesAndAddresses) {
    const HostNames names({"Workstation", "workstation.local", "live.studio.lan"});
    for (const char* host :
         {"localhost", "live.localhost", "127.0.0.1", "127.8.9.1", "::1", "192.168.1.5", "fe80::1",
          "workstation", "workstation.local", "live.studio.lan"})
        EXPECT_TRUE(names.allows(host)) << host;
    for (const char* host : {"evil.example", "localhost.evil.example", "workstation.evil.example",
                             "live.studio.lan.evil.example", "notlocalhost",
                             "127.0.0.1.evil.example", "studio.lan", "127.1", "2130706433"})
        EXPECT_FALSE(names.allows(host)) << host;
}

TEST(HostNames, AStarAllowsEveryHost) {
    EXPECT_TRUE(HostNames({"*"}).allows("evil.example"));
    EXPECT_FALSE(HostNames({"", "not a host"}).allows("evil.example"));
}

TEST(HostNames, ThisMachineHasItsOwnName) {
    const auto names = namesOfThisMachine(true);
    ASSERT_EQ(names.size(), 2u);
    EXPECT_TRUE(HostNames(names).allows(*hostOf(names.front())));
}

}  // namespace

}  // namespace usdlive::server
