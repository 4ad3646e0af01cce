// Computes a SHA-256 with OpenSSL.
#include "usdlive/common/core/Sha256.h"

#include <openssl/evp.h>

#include <stdexcept>

namespace usdlive {

namespace {

// Fetched once, because EVP_sha256() searches for the implementation at every use.
const EVP_MD* algorithm() {
    static const EVP_MD* const found = EVP_MD_fetch(nullptr, "SHA256", nullptr);
    return found;
}

void require(bool done) {
    if (!done) throw std::runtime_error("OpenSSL cannot compute a SHA-256");
}

}  // namespace

void Sha256::Free::operator()(evp_md_ctx_st* context) const { EVP_MD_CTX_free(context); }

Sha256::Sha256() : context_(EVP_MD_CTX_new()) {
    require(algorithm() && context_ &&
            EVP_DigestInit_ex2(context_.get(), algorithm(), nullptr) == 1);
}

void Sha256::add(ByteView part) {
    require(EVP_DigestUpdate(context_.get(), part.data(), part.size()) == 1);
}

Hash Sha256::finish() {
    Hash hash;
    require(EVP_DigestFinal_ex(context_.get(), hash.bytes.data(), nullptr) == 1);
    return hash;
}

}  // namespace usdlive
