// Makes the keys of OpenSSL from a JWK Set.
#include <openssl/bn.h>
#include <openssl/core_names.h>
#include <openssl/err.h>
#include <openssl/evp.h>
#include <openssl/param_build.h>

#include <memory>
#include <new>
#include <nlohmann/json.hpp>

#include "auth/OpenIdConnect.h"
#include "auth/StrictJson.h"
#include "usdlive/common/core/Base64Url.h"

namespace usdlive::server {

namespace {

using Json = nlohmann::json;
using Algorithm = IssuerKeys::Algorithm;

constexpr std::size_t kMostIssuerKeys = 100;
constexpr std::size_t kLeastRsaBytes = 2048 / 8, kMostRsaBytes = 8192 / 8, kMostExponentBytes = 8;
constexpr std::size_t kCurveBytes = 32;  // a coordinate of P-256, or a key of Ed25519
constexpr std::uint8_t kUncompressed = 4;

struct FreeOpenSsl {
    void operator()(BIGNUM* number) const { BN_free(number); }
    void operator()(EVP_PKEY_CTX* context) const { EVP_PKEY_CTX_free(context); }
    void operator()(OSSL_PARAM_BLD* builder) const { OSSL_PARAM_BLD_free(builder); }
    void operator()(OSSL_PARAM* parameters) const { OSSL_PARAM_free(parameters); }
};
template <class T>
using Owned = std::unique_ptr<T, FreeOpenSsl>;

std::string_view textIn(const Json& object, const char* name) {
    const auto found = object.find(name);
    return found != object.end() && found->is_string() ? found->get_ref<const std::string&>()
                                                       : std::string_view();
}

std::optional<Bytes> bytesIn(const Json& object, const char* name) {
    const std::string_view text = textIn(object, name);
    return text.empty() ? std::nullopt : base64UrlDecoded(text);
}

std::shared_ptr<EVP_PKEY> shared(EVP_PKEY* key) {
    ERR_clear_error();
    return key ? std::shared_ptr<EVP_PKEY>(key, EVP_PKEY_free) : nullptr;
}

/// Returns the key that the parameters describe, or nullptr if they describe none.
std::shared_ptr<EVP_PKEY> made(const char* type, OSSL_PARAM_BLD* builder) {
    const Owned<OSSL_PARAM> parameters(OSSL_PARAM_BLD_to_param(builder));
    const Owned<EVP_PKEY_CTX> context(EVP_PKEY_CTX_new_from_name(nullptr, type, nullptr));
    if (!parameters || !context) throw std::bad_alloc();
    EVP_PKEY* key = nullptr;
    if (EVP_PKEY_fromdata_init(context.get()) != 1 ||
        EVP_PKEY_fromdata(context.get(), &key, EVP_PKEY_PUBLIC_KEY, parameters.get()) != 1)
        key = nullptr;
    return shared(key);
}

Owned<OSSL_PARAM_BLD> builder() {
    Owned<OSSL_PARAM_BLD> made(OSSL_PARAM_BLD_new());
    if (!made) throw std::bad_alloc();
    return made;
}

Owned<BIGNUM> number(const Bytes& bytes) {
    Owned<BIGNUM> made(BN_bin2bn(bytes.data(), int(bytes.size()), nullptr));
    if (!made) throw std::bad_alloc();
    return made;
}

void readRsa(const Json& json, IssuerKeys::Key& into) {
    const auto modulus = bytesIn(json, "n"), exponent = bytesIn(json, "e");
    if (!modulus || !exponent || modulus->size() > kMostRsaBytes ||
        exponent->size() > kMostExponentBytes)
        return;
    const auto n = number(*modulus), e = number(*exponent);
    if (BN_is_odd(n.get()) == 0 || BN_is_odd(e.get()) == 0 || BN_is_one(e.get()) == 1) return;
    into.algorithm = Algorithm::Rs256;
    into.isShort = std::size_t(BN_num_bits(n.get())) < kLeastRsaBytes * 8;
    if (into.isShort) return;
    const auto parts = builder();
    if (OSSL_PARAM_BLD_push_BN(parts.get(), OSSL_PKEY_PARAM_RSA_N, n.get()) != 1 ||
        OSSL_PARAM_BLD_push_BN(parts.get(), OSSL_PKEY_PARAM_RSA_E, e.get()) != 1)
        throw std::bad_alloc();
    into.key = made("RSA", parts.get());
}

void readCurve(const Json& json, IssuerKeys::Key& into) {
    const auto x = bytesIn(json, "x"), y = bytesIn(json, "y");
    if (textIn(json, "crv") != "P-256" || !x || !y || x->size() != kCurveBytes ||
        y->size() != kCurveBytes)
        return;
    Bytes point{kUncompressed};
    point.insert(point.end(), x->begin(), x->end());
    point.insert(point.end(), y->begin(), y->end());
    const auto parts = builder();
    if (OSSL_PARAM_BLD_push_utf8_string(parts.get(), OSSL_PKEY_PARAM_GROUP_NAME, "prime256v1", 0) !=
            1 ||
        OSSL_PARAM_BLD_push_octet_string(parts.get(), OSSL_PKEY_PARAM_PUB_KEY, point.data(),
                                         point.size()) != 1)
        throw std::bad_alloc();
    into.algorithm = Algorithm::Es256;
    into.key = made("EC", parts.get());  // none if the point is not on the curve
}

void readEdwards(const Json& json, IssuerKeys::Key& into) {
    const auto x = bytesIn(json, "x");
    if (textIn(json, "crv") != "Ed25519" || !x || x->size() != kCurveBytes) return;
    into.algorithm = Algorithm::EdDsa;
    into.key =
        shared(EVP_PKEY_new_raw_public_key_ex(nullptr, "ED25519", nullptr, x->data(), x->size()));
}

std::string_view nameOf(Algorithm algorithm) {
    constexpr std::string_view kNames[] = {"RS256", "ES256", "EdDSA"};
    return kNames[std::size_t(algorithm)];
}

/// Returns whether the issuer gives the key away for checking signatures.
bool isForSignatures(const Json& json) {
    if (const auto use = json.find("use"); use != json.end() && *use != "sig") return false;
    const auto operations = json.find("key_ops");
    if (operations == json.end()) return true;
    if (!operations->is_array()) return false;
    for (const Json& one : *operations)
        if (one == "verify") return true;
    return false;
}

IssuerKeys::Key keyOf(const Json& json) {
    IssuerKeys::Key key;
    if (const auto id = json.find("kid"); id != json.end() && id->is_string())
        key.id = id->get<std::string>();
    if (!isForSignatures(json)) return key;
    const std::string_view type = textIn(json, "kty");
    if (type == "RSA") readRsa(json, key);
    if (type == "EC") readCurve(json, key);
    if (type == "OKP") readEdwards(json, key);
    const auto algorithm = json.find("alg");
    const bool isOther =
        key.algorithm && algorithm != json.end() && *algorithm != nameOf(*key.algorithm);
    if (isOther || (!key.key && !key.isShort)) key = {key.id, std::nullopt, false, nullptr};
    return key;
}

}  // namespace

Result<IssuerKeys> IssuerKeys::parse(std::string_view text) {
    const auto wrong = [](const std::string& why) {
        return fail(ErrorCode::InvalidConfiguration, why);
    };
    if (text.size() > kMostBytes)
        return wrong("the keys have more than " + std::to_string(kMostBytes) + " bytes");
    const auto json = parseStrictly(text);
    if (!json) return wrong("the keys are not a JSON object in which each member is once");
    const auto list = json->find("keys");
    if (list == json->end() || !list->is_array()) return wrong("the keys have no list \"keys\"");
    if (list->size() > kMostIssuerKeys)
        return wrong("there are more than " + std::to_string(kMostIssuerKeys) + " keys");
    IssuerKeys all;
    bool isUsable = false;
    for (const nlohmann::json& one : *list) {
        if (!one.is_object()) continue;
        all.keys_.push_back(keyOf(one));
        isUsable = isUsable || all.keys_.back().key;
    }
    if (!isUsable)
        return wrong(
            "none of the keys can check a signature with RS256 (2048 bits or more), ES256 or "
            "EdDSA (Ed25519)");
    return all;
}

}  // namespace usdlive::server
