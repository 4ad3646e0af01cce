// Passes hostile tokens and keys to the check of an issuer's tokens (AC20-AC22).
#include <algorithm>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>

#include "auth/OpenIdConnect.h"
#include "fuzz/Fuzz.h"
#include "unit/server/auth/TestIssuer.h"

namespace usdlive::fuzz {

namespace {

using namespace usdlive::server;
using Json = nlohmann::json;

constexpr std::int64_t kTime = 1'800'000'000;
const IssuerRules kRules{"https://id.example", "usdlive", "sub", "/groups/all"};

const TestKey& key() {
    static const TestKey made = TestKey::edwards("key");
    return made;
}
const IssuerKeys& keys() {
    static const IssuerKeys made =
        IssuerKeys::parse(Json{{"keys", Json::array({key().published()})}}.dump()).value();
    return made;
}
Json goodClaims() {
    return {{"iss", kRules.issuer},
            {"aud", kRules.audience},
            {"sub", "ann"},
            {"exp", kTime + 1},
            {"groups", {{"all", {"a"}}}}};
}

/// Checks a token by keys that do not know it.
void checkStranger(std::string_view token) {
    const auto checked = checkIssuedToken(token, keys(), kRules, kTime);
    require(!checked, "nobody has signed the input");
    require(!describe(checked.error()).empty(), "a refusal has a reason");
    require(isIssuedToken(token) || checked.error() == TokenProblem::NotThreeParts ||
                checked.error() == TokenProblem::TooLong,
            "a token has two dots");
}

/// Checks claims and headers that the issuer itself has signed.
void checkSigned(std::string_view header, std::string_view claims) {
    const auto checked = checkIssuedToken(key().signText(header, claims), keys(), kRules, kTime);
    if (!checked) return;
    require(checked->endsAt > kTime, "a token that has ended is refused");
    require(!checked->user.empty(), "a user has a name");
    const Json json = Json::parse(claims);
    require(json.at("iss") == kRules.issuer && json.at("exp") == checked->endsAt,
            "the claims are those of the issuer");
}

void checkKeys(std::string_view text) {
    const auto parsed = IssuerKeys::parse(text);
    if (!parsed) return require(!parsed.error().message.empty(), "a refusal has a reason");
    for (const IssuerKeys::Key& one : parsed->keys())
        require(!one.key || (one.algorithm && !one.isShort), "a key that is used has an algorithm");
    require(!checkIssuedToken(key().sign(goodClaims()), *parsed, kRules, kTime) ||
                text.find(key().published()["x"].get<std::string>()) != std::string_view::npos,
            "other keys do not accept the token");
}

}  // namespace

std::vector<Bytes> seeds() {
    std::vector<Bytes> all;
    const auto add = [&](std::string text) { all.emplace_back(text.begin(), text.end()); };
    const std::string claims = goodClaims().dump();
    add(key().header().dump() + "\n" + claims);
    // A token that another key has signed.
    add(TestKey::edwards("key").sign(goodClaims()));
    Json published =
        Json::array({TestKey::curve("curve").published(), TestKey::edwards("other").published(),
                     TestKey::rsa("rsa").published()});
    add(Json{{"keys", published}}.dump());
    return all;
}

}  // namespace usdlive::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    using namespace usdlive::fuzz;
    const std::string_view input(reinterpret_cast<const char*>(data), size);
    checkStranger(input);
    checkKeys(input);
    const auto end = std::min(input.find('\n'), input.size());
    checkSigned(input.substr(0, end), input.substr(std::min(end + 1, input.size())));
    checkSigned(key().header().dump(), input);
    return 0;
}
