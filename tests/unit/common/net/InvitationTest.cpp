// Tests the text of invitations (AC2).
#include "usdlive/common/net/Invitation.h"

#include <gtest/gtest.h>

namespace usdlive {
namespace {

const std::string kCode(64, 'a'), kPin = "sha256:" + std::string(64, 'b');

TEST(Invitation, ReadsBackItsText) {
    for (const Invitation& one :
         {Invitation{"studio", 7447, kCode, false, ""}, Invitation{"::1", 1, kCode, true, ""},
          Invitation{"10.0.0.5", 65535, kCode, true, kPin}}) {
        const auto read = parseInvitation(" " + one.text() + "\n");
        ASSERT_TRUE(read) << read.error().message;
        EXPECT_EQ(*read, one);
        EXPECT_TRUE(isInvitation(one.text()));
    }
    EXPECT_EQ(parseInvitation("usdlive-invitation://STUDIO:1/" + kCode)->host, "studio");
}

TEST(Invitation, DamageIsNamedWithoutTheCode) {
    const std::string scheme = "usdlive-invitation://";
    for (const std::string& text :
         {std::string(), scheme, scheme + "h:1", scheme + "h/" + kCode, scheme + ":1/" + kCode,
          scheme + "h:0/" + kCode, scheme + "h:99999/" + kCode, scheme + "h:1x/" + kCode,
          scheme + "a b:1/" + kCode, scheme + "h:1/" + kCode.substr(1),
          scheme + "h:1/" + kCode + "?",
          scheme + "h:1/" + kCode + "?pin=", scheme + "h:1/" + kCode + "?pin=" + kPin.substr(1),
          scheme + "h:1/" + kCode + "?pin=" + kPin + "0", "ws://h:1/" + kCode}) {
        const auto read = parseInvitation(text);
        ASSERT_FALSE(read) << text;
        EXPECT_EQ(read.error().message.find(kCode.substr(1)), std::string::npos);
        EXPECT_EQ(read.error().code, ErrorCode::InvalidArgument);
    }
}

TEST(Invitation, AC12ATokenNamesItsAccountAndItsServer) {
    for (const ServiceToken& one :
         {ServiceToken{"farm", {"studio", 7447, kCode, false, ""}},
          ServiceToken{"farm@studio.example", {"::1", 1, kCode, true, kPin}}}) {
        const auto read = parseServiceToken(" " + one.text() + "\n");
        ASSERT_TRUE(read) << read.error().message;
        EXPECT_EQ(*read, one);
        EXPECT_FALSE(isInvitation(one.text()));
    }
    for (const std::string& text :
         {"usdlive-token://h:1/" + kCode, "usdlive-token://@h:1/" + kCode,
          "usdlive-token://a@h/" + kCode, "usdlive-token://a@h:1/" + kCode.substr(1),
          "usdlive-invitation://a@h:1/" + kCode, kCode}) {
        const auto read = parseServiceToken(text);
        ASSERT_FALSE(read) << text;
        EXPECT_EQ(read.error().message.find(kCode.substr(1)), std::string::npos);
        EXPECT_NE(read.error().message.find("the token is damaged"), std::string::npos);
    }
}

}  // namespace
}  // namespace usdlive
