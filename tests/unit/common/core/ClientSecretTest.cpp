// Tests ClientSecret: the ids of clients and what proves them.
#include "usdlive/common/core/ClientSecret.h"

#include <gtest/gtest.h>

using namespace usdlive;

TEST(ClientSecret, ID5AnIdIsTheHashOfItsSecret) {
    const Hash secret = *hashFromHex(std::string(64, '0'));
    EXPECT_EQ(clientIdOf(secret).value, "k66687aadf862bd776c8fc18b8e9f8e2");
    EXPECT_TRUE(needsSecret(clientIdOf(secret)));
    EXPECT_FALSE(needsSecret({"0123456789abcdef0123456789abcdef"})) << "of an earlier version";
    EXPECT_FALSE(needsSecret({"k"}));
    EXPECT_NE(newClientSecret(), newClientSecret());
}
