// Makes keys and signatures with OpenSSL.
#include "unit/server/auth/TestIssuer.h"

#include <openssl/bn.h>
#include <openssl/core_names.h>
#include <openssl/ecdsa.h>
#include <openssl/evp.h>
#include <openssl/rsa.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <stdexcept>

namespace usdlive::server {

namespace {

unsigned char* unsignedBytes(std::string& bytes) {
    return reinterpret_cast<unsigned char*>(bytes.data());
}
const unsigned char* unsignedBytes(std::string_view bytes) {
    return reinterpret_cast<const unsigned char*>(bytes.data());
}

/// Returns the number with `size` bytes, or with as many as it needs.
std::string bytesOf(const BIGNUM* number, std::size_t size = 0) {
    std::string bytes(std::max(size, std::size_t(BN_num_bytes(number))), '\0');
    BN_bn2binpad(number, unsignedBytes(bytes), int(bytes.size()));
    return bytes;
}

/// Returns the two numbers of a signature in DER.
std::string rawSignature(const std::string& der) {
    const auto* begin = unsignedBytes(std::string_view(der));
    ECDSA_SIG* signature = d2i_ECDSA_SIG(nullptr, &begin, long(der.size()));
    std::string bytes =
        bytesOf(ECDSA_SIG_get0_r(signature), 32) + bytesOf(ECDSA_SIG_get0_s(signature), 32);
    ECDSA_SIG_free(signature);
    return bytes;
}

}  // namespace

std::string base64Url(std::string_view bytes) {
    std::string text(4 * ((bytes.size() + 2) / 3), '\0');
    EVP_EncodeBlock(unsignedBytes(text), unsignedBytes(bytes), int(bytes.size()));
    text.erase(std::min(text.find('='), text.size()));
    for (char& character : text)
        character = character == '+' ? '-' : character == '/' ? '_' : character;
    return text;
}

TestKey::TestKey(std::string id, std::string algorithm, EVP_PKEY* key)
    : id(std::move(id)), algorithm(std::move(algorithm)), key_(key, EVP_PKEY_free) {}

TestKey TestKey::rsa(std::string id, unsigned bits) {
    return {std::move(id), "RS256", EVP_PKEY_Q_keygen(nullptr, nullptr, "RSA", std::size_t(bits))};
}
TestKey TestKey::curve(std::string id, const char* name) {
    return {std::move(id), "ES256", EVP_PKEY_Q_keygen(nullptr, nullptr, "EC", name)};
}
TestKey TestKey::edwards(std::string id) {
    return {std::move(id), "EdDSA", EVP_PKEY_Q_keygen(nullptr, nullptr, "ED25519")};
}

TestKey::Json TestKey::published() const {
    constexpr std::size_t kCoordinate = 32;
    Json key{{"kid", id}, {"alg", algorithm}, {"use", "sig"}};
    if (algorithm == "RS256") {
        key["kty"] = "RSA";
        key["n"] = base64Url(number(OSSL_PKEY_PARAM_RSA_N, 0));
        key["e"] = base64Url(number(OSSL_PKEY_PARAM_RSA_E, 0));
    } else if (algorithm == "ES256") {
        key["kty"] = "EC";
        key["crv"] = "P-256";
        key["x"] = base64Url(number(OSSL_PKEY_PARAM_EC_PUB_X, kCoordinate));
        key["y"] = base64Url(number(OSSL_PKEY_PARAM_EC_PUB_Y, kCoordinate));
    } else {
        std::string raw(32, '\0');
        std::size_t size = raw.size();
        EVP_PKEY_get_raw_public_key(key_.get(), unsignedBytes(raw), &size);
        key["kty"] = "OKP";
        key["crv"] = "Ed25519";
        key["x"] = base64Url(raw);
    }
    return key;
}

TestKey::Json TestKey::header() const { return {{"alg", algorithm}, {"kid", id}, {"typ", "JWT"}}; }

std::string TestKey::signature(std::string_view text) const {
    EVP_MD_CTX* context = EVP_MD_CTX_new();
    const char* digest = algorithm == "EdDSA" ? nullptr : "SHA256";
    std::string bytes(1024, '\0');
    std::size_t size = bytes.size();
    const bool isGood =
        EVP_DigestSignInit_ex(context, nullptr, digest, nullptr, nullptr, key_.get(), nullptr) ==
            1 &&
        EVP_DigestSign(context, unsignedBytes(bytes), &size, unsignedBytes(text), text.size()) == 1;
    EVP_MD_CTX_free(context);
    if (!isGood) throw std::runtime_error("cannot sign");
    bytes.resize(size);
    return algorithm == "ES256" ? rawSignature(bytes) : bytes;
}

std::string TestKey::signText(std::string_view header, std::string_view claims) const {
    const std::string text = base64Url(header) + "." + base64Url(claims);
    return text + "." + base64Url(signature(text));
}

std::string TestKey::sign(const Json& header, const Json& claims) const {
    return signText(header.dump(), claims.dump());
}

std::string TestKey::sign(const Json& claims) const { return sign(header(), claims); }

std::string TestKey::number(const char* name, std::size_t size) const {
    BIGNUM* value = nullptr;
    if (EVP_PKEY_get_bn_param(key_.get(), name, &value) != 1)
        throw std::runtime_error("the key has no such number");
    std::string bytes = bytesOf(value, size);
    BN_free(value);
    return bytes;
}

}  // namespace usdlive::server
