// Tests which tokens of an issuer are accepted, and attacks on the check (AC20-AC22).
#include "auth/OpenIdConnect.h"

#include <gtest/gtest.h>
#include <openssl/evp.h>
#include <openssl/hmac.h>

#include <functional>
#include <nlohmann/json.hpp>

#include "unit/server/auth/TestIssuer.h"

namespace usdlive::server {
namespace {

using Json = nlohmann::json;
using enum TokenProblem;
using namespace std::string_literals;

constexpr std::int64_t kIssued = 1'800'000'000;

class OpenIdConnect : public testing::Test {
protected:
    static const TestKey& rsa() {
        static const TestKey key = TestKey::rsa("rsa");
        return key;
    }
    static const TestKey& curve() {
        static const TestKey key = TestKey::curve("curve");
        return key;
    }
    static const TestKey& edwards() {
        static const TestKey key = TestKey::edwards("edwards");
        return key;
    }
    static IssuerKeys keysOf(const Json& list) {
        auto keys = IssuerKeys::parse(Json{{"keys", list}}.dump());
        if (!keys) throw std::runtime_error(keys.error().message);
        return *keys;
    }

    /// Returns the claims of a token that is accepted.
    static Json claims(const std::function<void(Json&)>& change = [](Json&) {}) {
        Json all{{"iss", "https://id.studio.example/realms/film"},
                 {"aud", "usdlive"},
                 {"sub", "f3a9"},
                 {"exp", kIssued + 300},
                 {"iat", kIssued},
                 {"nbf", kIssued},
                 {"email", "ann@studio.example"},
                 {"email_verified", true},
                 {"groups", {"lighting", "film"}}};
        change(all);
        return all;
    }
    static Json header(const TestKey& key, const std::function<void(Json&)>& change) {
        Json all = key.header();
        change(all);
        return all;
    }
    [[nodiscard]] std::optional<TokenProblem> problem(std::string_view token) const {
        const auto checked = checkIssuedToken(token, keys, rules, kIssued);
        return checked ? std::nullopt : std::optional(checked.error());
    }
    /// Expects that a token with these claims, signed correctly, is refused for this reason.
    void expectRefused(TokenProblem why, const std::function<void(Json&)>& change) const {
        const std::string token = rsa().sign(claims(change));
        EXPECT_EQ(problem(token), why) << claims(change).dump();
    }
    /// The same with claims as text.
    void expectTextRefused(TokenProblem why, const std::string& text) const {
        EXPECT_EQ(problem(rsa().signText(rsa().header().dump(), text)), why) << text;
    }

    IssuerKeys keys = keysOf({rsa().published(), curve().published(), edwards().published()});
    const IssuerRules rules{"https://id.studio.example/realms/film", "usdlive"};
};

TEST_F(OpenIdConnect, AC20ThreeAlgorithmsAreAccepted) {
    for (const TestKey* key : {&rsa(), &curve(), &edwards()}) {
        const auto checked = checkIssuedToken(key->sign(claims()), keys, rules, kIssued);
        ASSERT_TRUE(checked) << key->algorithm << ": " << describe(checked.error());
        EXPECT_EQ(checked->user, UserName{"ann@studio.example"});
        EXPECT_EQ(checked->groups, (std::set<std::string>{"lighting", "film"}));
        EXPECT_EQ(checked->endsAt, kIssued + 300);
        EXPECT_TRUE(isIssuedToken(key->sign(claims())));
    }
    EXPECT_FALSE(isIssuedToken(std::string(64, 'a')));
}

TEST_F(OpenIdConnect, EachProblemHasASentence) {
    for (int one = 0; one <= int(GroupsLeftOut); ++one)
        EXPECT_FALSE(describe(TokenProblem(one)).empty());
}

// ---- algorithms

TEST_F(OpenIdConnect, AttackNoSignature) {
    for (const char* none : {"none", "None", "NONE", "nOnE", ""}) {
        const Json head = header(rsa(), [&](Json& all) { all["alg"] = none; });
        const std::string text = base64Url(head.dump()) + "." + base64Url(claims().dump());
        EXPECT_EQ(problem(text + "."), NotThreeParts) << none;
        EXPECT_EQ(problem(text + ".AAAA"), Algorithm) << none;
        EXPECT_EQ(problem(rsa().sign(head, claims())), Algorithm) << none;
    }
    EXPECT_EQ(problem(rsa().sign(header(rsa(), [](Json& all) { all.erase("alg"); }), claims())),
              Algorithm);
}

TEST_F(OpenIdConnect, AttackThePublicKeyAsASecret) {
    // Somebody who knows the public key signs with it as the secret of HS256.
    const std::string secret = rsa().published()["n"];
    const Json head = header(rsa(), [](Json& all) { all["alg"] = "HS256"; });
    const std::string text = base64Url(head.dump()) + "." + base64Url(claims().dump());
    std::string mac(32, '\0');
    unsigned size = 0;
    HMAC(EVP_sha256(), secret.data(), int(secret.size()),
         reinterpret_cast<const unsigned char*>(text.data()), text.size(),
         reinterpret_cast<unsigned char*>(mac.data()), &size);
    EXPECT_EQ(problem(text + "." + base64Url(mac)), Algorithm);
    // The same, with an algorithm that is accepted.
    const std::string other = base64Url(rsa().header().dump()) + "." + base64Url(claims().dump());
    EXPECT_EQ(problem(other + "." + base64Url(mac)), Signature);
}

TEST_F(OpenIdConnect, AttackOtherAlgorithms) {
    for (const char* name : {"RS384", "RS512", "PS256", "ES384", "ES512", "ES256K", "HS512",
                             "rs256", "RS256 ", "Ed448", "dir", "A128KW"})
        EXPECT_EQ(
            problem(rsa().sign(header(rsa(), [&](Json& all) { all["alg"] = name; }), claims())),
            Algorithm)
            << name;
    for (const Json& value : {Json(256), Json(), Json::array({"RS256"}), Json::object()})
        EXPECT_EQ(
            problem(rsa().sign(header(rsa(), [&](Json& all) { all["alg"] = value; }), claims())),
            Algorithm);
}

TEST_F(OpenIdConnect, AttackKeyConfusion) {
    // The algorithm of one key with the id of another.
    for (const TestKey* key : {&curve(), &edwards()})
        EXPECT_EQ(
            problem(rsa().sign(header(rsa(), [&](Json& all) { all["kid"] = key->id; }), claims())),
            KeyUnfit);
    for (const char* name : {"ES256", "EdDSA"})
        EXPECT_EQ(
            problem(rsa().sign(header(rsa(), [&](Json& all) { all["alg"] = name; }), claims())),
            KeyUnfit);
    // Another key of the same algorithm.
    const TestKey second = TestKey::rsa("second");
    keys = keysOf({rsa().published(), second.published()});
    EXPECT_EQ(problem(second.sign(rsa().header(), claims())), Signature);
    EXPECT_FALSE(problem(second.sign(claims())));
}

TEST_F(OpenIdConnect, AttackPsychicSignatures) {
    const std::string text = base64Url(curve().header().dump()) + "." + base64Url(claims().dump());
    const std::string good = curve().signature(text);
    EXPECT_FALSE(problem(text + "." + base64Url(good)));
    const std::string zeros(64, '\0');
    EXPECT_EQ(problem(text + "." + base64Url(zeros)), Signature);
    // One number alone, the order of the group, sizes that do not fit, and DER.
    std::string order =
        "\xff\xff\xff\xff\x00\x00\x00\x00\xff\xff\xff\xff\xff\xff\xff\xff\xbc\xe6\xfa\xad\xa7\x17"
        "\x9e\x84\xf3\xb9\xca\xc2\xfc\x63\x25\x51"s;
    for (const std::string& bytes :
         {good.substr(0, 32) + zeros.substr(32), zeros.substr(32) + good.substr(32), order + order,
          good.substr(0, 63), good + std::string(1, '\0'), zeros + zeros, std::string("0"),
          "\x30\x06\x02\x01\x00\x02\x01\x00"s})
        EXPECT_EQ(problem(text + "." + base64Url(bytes)), Signature);
    const std::string edwardsText =
        base64Url(edwards().header().dump()) + "." + base64Url(claims().dump());
    EXPECT_EQ(problem(edwardsText + "." + base64Url(zeros)), Signature);
    const std::string rsaText = base64Url(rsa().header().dump()) + "." + base64Url(claims().dump());
    for (const std::size_t size : {1, 255, 256, 257})
        EXPECT_EQ(problem(rsaText + "." + base64Url(std::string(size, '\0'))), Signature);
}

// ---- keys

TEST_F(OpenIdConnect, AttackKeyIds) {
    for (const char* id : {"../../../../dev/null", "/etc/passwd", "rsa' OR '1'='1", "| whoami",
                           "https://evil.example/keys", "", "RSA"})
        EXPECT_EQ(problem(rsa().sign(header(rsa(), [&](Json& all) { all["kid"] = id; }), claims())),
                  UnknownKey)
            << id;
    for (const Json& id : {Json(1), Json(), Json::array({"rsa"}), Json{{"kid", "rsa"}}})
        EXPECT_EQ(problem(rsa().sign(header(rsa(), [&](Json& all) { all["kid"] = id; }), claims())),
                  KeyIdNotText);
}

TEST_F(OpenIdConnect, AttackKeysInTheHeader) {
    const TestKey evil = TestKey::rsa("evil");
    for (const bool knowsId : {true, false}) {
        const Json head = header(evil, [&](Json& all) {
            if (knowsId) all["kid"] = "rsa";
            all["jwk"] = evil.published();
            all["jku"] = "https://evil.example/keys";
            all["x5u"] = "https://evil.example/certificate";
            all["x5c"] = {"MIIB"};
        });
        EXPECT_EQ(problem(evil.sign(head, claims())), knowsId ? Signature : UnknownKey);
    }
    // The issuer may name its certificate; nothing is fetched.
    EXPECT_FALSE(problem(rsa().sign(
        header(rsa(), [](Json& all) { all["x5u"] = "https://id.studio.example/x"; }), claims())));
}

TEST_F(OpenIdConnect, AttackWithoutAKeyId) {
    const auto without = [](const TestKey& key) {
        return key.sign(header(key, [](Json& all) { all.erase("kid"); }), claims());
    };
    EXPECT_FALSE(problem(without(rsa())));  // only one key is for RS256
    EXPECT_EQ(problem(without(TestKey::rsa("evil"))), Signature);
    keys = keysOf({rsa().published(), TestKey::rsa("second").published()});
    EXPECT_EQ(problem(without(rsa())), KeyNotNamed);
    EXPECT_EQ(problem(without(curve())), KeyUnfit);
    keys = {};
    EXPECT_EQ(problem(without(rsa())), UnknownKey);
}

TEST_F(OpenIdConnect, AttackWeakKeys) {
    const TestKey weak = TestKey::rsa("weak", 1024);
    keys = keysOf({weak.published(), rsa().published()});
    EXPECT_EQ(problem(weak.sign(claims())), KeyTooShort);
    EXPECT_FALSE(IssuerKeys::parse(Json{{"keys", {weak.published()}}}.dump()));
    // A short key with zeros before it is a short key.
    Json padded = TestKey::rsa("padded", 1024).published();
    padded["n"] = std::string(172, 'A') + padded["n"].get<std::string>();  // 129 bytes
    EXPECT_FALSE(IssuerKeys::parse(Json{{"keys", {padded}}}.dump()));
}

TEST_F(OpenIdConnect, AttackOtherCurvesAndPurposes) {
    const auto unfit = [&](const std::function<void(Json&)>& change, const TestKey& key) {
        Json published = key.published();
        change(published);
        keys = keysOf({published, TestKey::edwards("other").published()});
        return problem(key.sign(claims()));
    };
    EXPECT_FALSE(unfit([](Json&) {}, curve()));
    for (const char* name : {"P-384", "P-521", "secp256k1", "Ed25519", ""})
        EXPECT_EQ(unfit([&](Json& key) { key["crv"] = name; }, curve()), KeyUnfit) << name;
    // A point that is not on the curve.
    const std::string one = base64Url(std::string(31, '\0') + '\1');
    EXPECT_EQ(unfit([&](Json& key) { key["x"] = key["y"] = one; }, curve()), KeyUnfit);
    EXPECT_EQ(unfit([&](Json& key) { key["x"] = base64Url(std::string(31, '\1')); }, curve()),
              KeyUnfit);
    EXPECT_EQ(unfit([](Json& key) { key["use"] = "enc"; }, rsa()), KeyUnfit);
    EXPECT_EQ(unfit([](Json& key) { key["key_ops"] = {"encrypt"}; }, rsa()), KeyUnfit);
    EXPECT_FALSE(unfit([](Json& key) { key["key_ops"] = {"verify"}; }, rsa()));
    EXPECT_EQ(unfit([](Json& key) { key["alg"] = "RSA-OAEP"; }, rsa()), KeyUnfit);
    EXPECT_EQ(unfit([](Json& key) { key["kty"] = "oct"; }, rsa()), KeyUnfit);
    EXPECT_EQ(unfit([](Json& key) { key["e"] = "AQ"; }, rsa()), KeyUnfit);  // 1
    EXPECT_EQ(unfit([](Json& key) { key["n"] = "AQAB*"; }, rsa()), KeyUnfit);
    EXPECT_FALSE(unfit([](Json& key) { key.erase("alg"); }, rsa()));
    // With a signature on another curve.
    const TestKey large = TestKey::curve("curve", "P-384");
    keys = keysOf(Json::array({curve().published()}));
    const std::string text = base64Url(curve().header().dump()) + "." + base64Url(claims().dump());
    EXPECT_EQ(problem(text + "." + base64Url(large.signature(text))), Signature);
}

TEST_F(OpenIdConnect, KeysThatCannotBeUsedAreNamed) {
    for (const char* text : {"", "[]", "{}", R"({"keys": 1})", R"({"keys": []})", "{\"keys\": [1]}",
                             R"({"keys": [], "keys": []})", R"({"keys": [{"kty": "RSA"}]})"}) {
        const auto parsed = IssuerKeys::parse(text);
        ASSERT_FALSE(parsed) << text;
        EXPECT_EQ(parsed.error().code, ErrorCode::InvalidConfiguration);
    }
    Json many = Json::array();
    for (int one = 0; one < 101; ++one) many.push_back(edwards().published());
    EXPECT_FALSE(IssuerKeys::parse(Json{{"keys", many}}.dump()));
    Json large{{"keys", {rsa().published()}}};
    EXPECT_TRUE(IssuerKeys::parse(large.dump()));
    EXPECT_FALSE(IssuerKeys::parse(large.dump() + std::string(IssuerKeys::kMostBytes, ' ')));
}

// ---- the header

TEST_F(OpenIdConnect, AttackExtensions) {
    for (const Json& critical : {Json::array({"exp"}), Json::array(), Json("exp")})
        EXPECT_EQ(problem(rsa().sign(header(rsa(), [&](Json& all) { all["crit"] = critical; }),
                                     claims())),
                  Critical);
    EXPECT_EQ(problem(rsa().sign(header(rsa(), [](Json& all) { all["b64"] = false; }), claims())),
              Critical);
}

TEST_F(OpenIdConnect, AttackTokensOfOtherPurposes) {
    const auto typed = [&](const Json& type) {
        return problem(rsa().sign(header(rsa(), [&](Json& all) { all["typ"] = type; }), claims()));
    };
    for (const char* good : {"JWT", "jwt", "at+jwt", "application/at+jwt"})
        EXPECT_FALSE(typed(good)) << good;
    for (const char* other : {"logout+jwt", "secevent+jwt", "dpop+jwt", "JWE", "Refresh", ""})
        EXPECT_EQ(typed(other), OtherType) << other;
    EXPECT_EQ(typed(1), OtherType);
    EXPECT_FALSE(problem(rsa().sign(header(rsa(), [](Json& all) { all.erase("typ"); }), claims())));
    expectRefused(OtherType, [](Json& all) {
        all["events"] = {{"http://schemas.openid.net/event/backchannel-logout", Json::object()}};
    });
}

// ---- claims

TEST_F(OpenIdConnect, AttackTimes) {
    expectRefused(Expired, [](Json& all) { all["exp"] = kIssued; });
    expectRefused(Expired, [](Json& all) { all["exp"] = 0; });
    expectRefused(NoExpiry, [](Json& all) { all.erase("exp"); });
    for (const Json& wrong :
         {Json(std::to_string(kIssued + 300)), Json(double(kIssued) + 300.5), Json(1e300), Json(-1),
          Json(), Json(true), Json::array({kIssued + 300}), Json(std::int64_t(253'402'300'800)),
          Json(std::uint64_t(-1))}) {
        expectRefused(TimeNotValid, [&](Json& all) { all["exp"] = wrong; });
        expectRefused(TimeNotValid, [&](Json& all) { all["nbf"] = wrong; });
        expectRefused(TimeNotValid, [&](Json& all) { all["iat"] = wrong; });
    }
    std::string text = claims([](Json& all) { all.erase("exp"); }).dump();
    text.back() = ',';
    for (const char* number : {"1e400", "01800000300", "18e8", "99999999999999999999999", "NaN"})
        EXPECT_TRUE(
            problem(rsa().signText(rsa().header().dump(), text + "\"exp\":" + number + "}")))
            << number;
    for (const char* name : {"nbf", "iat"}) {
        expectRefused(NotYetValid, [&](Json& all) { all[name] = kIssued + kClockLeeway + 1; });
        EXPECT_FALSE(
            problem(rsa().sign(claims([&](Json& all) { all[name] = kIssued + kClockLeeway; }))));
        EXPECT_FALSE(problem(rsa().sign(claims([&](Json& all) { all.erase(name); }))));
    }
    EXPECT_FALSE(problem(rsa().sign(claims([](Json& all) { all["exp"] = kIssued + 1; }))));
}

TEST_F(OpenIdConnect, AttackAudiences) {
    const auto with = [](const Json& audience) {
        return [audience](Json& all) { all["aud"] = audience; };
    };
    for (const Json& wrong :
         {Json("other"), Json("usdlive "), Json("USDLIVE"), Json(""), Json(), Json(1),
          Json::array(), Json::array({"other", "usdlive2"}), Json::array({1, "usdlive"}),
          Json::array({Json::array({"usdlive"})}), Json{{"usdlive", "usdlive"}}})
        expectRefused(Audience, with(wrong));
    expectRefused(Audience, [](Json& all) { all.erase("aud"); });
    EXPECT_FALSE(problem(rsa().sign(claims(with({"other", "usdlive"})))));
}

TEST_F(OpenIdConnect, AttackIssuers) {
    const std::string good = rules.issuer;
    for (const Json& wrong :
         {Json(good + "/"), Json(good.substr(0, good.size() - 1)), Json("http" + good.substr(5)),
          Json("https://evil.example/"), Json("https://ID.studio.example/realms/film"),
          Json(good + "\0"s), Json(), Json::array({good}), Json("")})
        expectRefused(Issuer, [&](Json& all) { all["iss"] = wrong; });
    expectRefused(Issuer, [](Json& all) { all.erase("iss"); });
}

TEST_F(OpenIdConnect, AC22TheUserIsAClaimThatIsVerified) {
    for (const Json& wrong : {Json(false), Json("true"), Json(1), Json()})
        expectRefused(EmailNotVerified, [&](Json& all) { all["email_verified"] = wrong; });
    expectRefused(EmailNotVerified, [](Json& all) { all.erase("email_verified"); });
    expectRefused(NoUser, [](Json& all) { all.erase("email"); });
    expectRefused(NoUser, [](Json& all) { all["email"] = 1; });
    for (const char* name :
         {"", "ann b", "ann/../bob", "ann\nbob", "\xc3\xa4nn@studio.example", "<script>", "ann\\"})
        expectRefused(UserNotValid, [&](Json& all) { all["email"] = name; });
    expectRefused(UserNotValid, [](Json& all) { all["email"] = std::string(65, 'a'); });
    expectRefused(NoSubject, [](Json& all) { all.erase("sub"); });
    expectRefused(NoSubject, [](Json& all) { all["sub"] = ""; });
    expectRefused(NoSubject, [](Json& all) { all["sub"] = 7; });
    expectRefused(NoSubject, [](Json& all) { all["sub"] = std::string(256, 'a'); });
    IssuerRules other = rules;
    other.userClaim = "sub";
    const std::string token = rsa().sign(claims([](Json& all) { all.erase("email"); }));
    EXPECT_EQ(checkIssuedToken(token, keys, other, kIssued)->user, UserName{"f3a9"});
}

TEST_F(OpenIdConnect, AC22GroupsAreAClaim) {
    const auto groups = [&](const Json& claim, const char* name = "groups") {
        IssuerRules chosen = rules;
        chosen.groupsClaim = name;
        const std::string token = rsa().sign(claims([&](Json& all) { all["groups"] = claim; }));
        const auto checked = checkIssuedToken(token, keys, chosen, kIssued);
        return checked ? checked->groups : std::set<std::string>{"refused"};
    };
    EXPECT_EQ(groups("one"), std::set<std::string>{"one"});
    EXPECT_EQ(groups(Json::array()), std::set<std::string>());
    EXPECT_EQ(groups("one", "missing"), std::set<std::string>());
    EXPECT_EQ(groups({{"roles", {"a", "b"}}}, "/groups/roles"), (std::set<std::string>{"a", "b"}));
    EXPECT_EQ(groups({{"roles", {"a"}}}, "/groups/roles/none/0"), std::set<std::string>());
    expectRefused(GroupsNotValid, [](Json& all) { all["groups"] = 7; });
    expectRefused(GroupsNotValid, [](Json& all) { all["groups"] = {"a", 7}; });
    expectRefused(GroupsNotValid, [](Json& all) { all["groups"] = {{"a", "b"}}; });
    expectRefused(GroupsNotValid, [](Json& all) { all["groups"] = {std::string(1025, 'a')}; });
    expectRefused(GroupsNotValid, [](Json& all) {
        for (int one = 0; one < 1001; ++one) all["groups"].push_back(std::to_string(one));
    });
    // An issuer that leaves out groups says so; a rule might deny something to one of them.
    expectRefused(GroupsLeftOut, [](Json& all) {
        all.erase("groups");
        all["_claim_names"] = {{"groups", "src1"}};
    });
    EXPECT_TRUE(checkClaim("/a/b"));
    EXPECT_TRUE(checkClaim("https://studio.example/groups"));
    EXPECT_FALSE(checkClaim(""));
    EXPECT_FALSE(checkClaim("/a~2"));
}

// ---- the form

TEST_F(OpenIdConnect, AttackForms) {
    const std::string good = rsa().sign(claims());
    const auto first = good.find('.'), second = good.rfind('.');
    const std::string head = good.substr(0, first), text = good.substr(first, second - first),
                      signature = good.substr(second + 1);
    EXPECT_FALSE(problem(good));
    for (const std::string& wrong :
         {std::string(), std::string("."), std::string(".."), std::string("..."), head, head + text,
          head + text + ".", good + ".", good + ".x", "." + good, head + ".." + signature,
          "." + text.substr(1) + "." + signature})
        EXPECT_EQ(problem(wrong), NotThreeParts) << wrong;
    EXPECT_EQ(problem(good.substr(0, good.size() - 1)), Signature);
    EXPECT_EQ(problem(good.substr(0, good.size() - 2)), Signature);
    EXPECT_EQ(problem(good + "A"), Signature);
    for (const char* more : {"=", "==", " ", "\n", "+", "/", "%3D", "\xff"}) {
        EXPECT_EQ(problem(good + more), Signature) << more;
        EXPECT_EQ(problem(head + more + text + "." + signature), NotBase64Url) << more;
        EXPECT_EQ(problem(more + good), NotBase64Url) << more;
    }
    EXPECT_EQ(problem(good + std::string(1, '\0')), Signature);
    // The last character of 256 bytes has four spare bits. With others set, the bytes are the same.
    std::string spare = good;
    spare.back() = char(spare.back() + 1);
    EXPECT_EQ(problem(spare), Signature);
    // Each changed byte of the claims changes the signature.
    for (std::size_t at = first + 1; at < second; at += 7) {
        std::string changed = good;
        changed[at] = changed[at] == 'A' ? 'B' : 'A';
        EXPECT_TRUE(problem(changed)) << at;
    }
}

TEST_F(OpenIdConnect, AttackJson) {
    const std::string good = claims().dump();
    EXPECT_FALSE(problem(rsa().signText(rsa().header().dump(), good)));
    for (const char* text : {"[]", "1", "null", "\"claims\"", "true"})
        expectTextRefused(NotAnObject, text);
    for (const std::string& text :
         {std::string("{"), good + "x", good + good, std::string("{\"iss\":\"\xff\xfe\"}"),
          std::string("{\"iss\":\"\\ud800\"}"), std::string("{'iss':1}"), "// x\n" + good,
          good.substr(0, good.size() - 1)})
        expectTextRefused(NotJson, text);
    // The first value for one reader is the second one for another.
    std::string twice = good;
    twice.back() = ',';
    expectTextRefused(MemberTwice, twice + "\"aud\":\"usdlive\"}");
    expectTextRefused(MemberTwice, twice + "\"a\\u0075d\":\"usdlive\"}");
    expectTextRefused(MemberTwice, twice + "\"x\":{\"y\":1,\"y\":2}}");
    EXPECT_EQ(problem(rsa().signText(R"({"alg":"none","alg":"RS256","kid":"rsa"})", good)),
              MemberTwice);
    EXPECT_EQ(problem(rsa().signText(R"(["RS256"])", good)), NotAnObject);
    EXPECT_EQ(problem(rsa().signText(R"({"alg":"RS256")", good)), NotJson);
    // Bombs.
    for (const char* open : {"[", "{\"a\":"}) {
        std::string bomb = "{\"iss\":";
        while (bomb.size() < 9'000) bomb += open;
        expectTextRefused(TooDeep, bomb);
        EXPECT_EQ(problem(rsa().signText(bomb, good)), TooDeep);
    }
    const std::string deep = "{\"a\":" + std::string(15, '[') + std::string(15, ']') + "}";
    expectTextRefused(Issuer, deep);  // read to its end
    expectTextRefused(TooDeep, "{\"a\":[" + deep + "]}");
}

TEST_F(OpenIdConnect, AttackSizes) {
    const auto padded = [&](std::size_t size) {
        return rsa().sign(claims([&](Json& all) { all["x"] = std::string(size, 'x'); }));
    };
    EXPECT_FALSE(problem(padded(10'000)));
    EXPECT_EQ(problem(padded(13'000)), TooLong);
    EXPECT_EQ(problem(std::string(kMostTokenBytes + 1, '.')), TooLong);
}

}  // namespace
}  // namespace usdlive::server
