// Hashes with OpenSSL.
#include "Digest.h"

#include <openssl/evp.h>

#include <stdexcept>
#include <string_view>

namespace usdlive::resolver {

struct Digest::State {
    EVP_MD_CTX* context = EVP_MD_CTX_new();
    ~State() { EVP_MD_CTX_free(context); }
};

Digest::Digest() : state_(std::make_unique<State>()) {
    if (EVP_DigestInit_ex(state_->context, EVP_sha256(), nullptr) != 1)
        throw std::runtime_error("OpenSSL cannot compute a SHA-256");
}

Digest::~Digest() = default;

void Digest::add(const void* data, std::size_t size) {
    EVP_DigestUpdate(state_->context, data, size);
}

std::string Digest::hex() {
    unsigned char bytes[EVP_MAX_MD_SIZE];
    unsigned size = 0;
    EVP_DigestFinal_ex(state_->context, bytes, &size);
    constexpr std::string_view kDigits = "0123456789abcdef";
    std::string text;
    for (unsigned i = 0; i < size; ++i) {
        text += kDigits[bytes[i] >> 4];
        text += kDigits[bytes[i] & 15];
    }
    return text;
}

// ---- PartsDigest

char* PartsDigest::memoryOf(std::size_t part) { return memory_.get() + part % kParts * kPartBytes; }

std::span<char> PartsDigest::space() {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [this] { return added_ - hashed_ < kParts; });
    return {memoryOf(added_), kPartBytes};
}

void PartsDigest::add(std::size_t size) {
    {
        const std::lock_guard lock(mutex_);
        sizes_[added_ % kParts] = size;
        ++added_;
    }
    changed_.notify_one();
    if (added_ == 2) thread_ = std::thread([this] { hash(); });
}

std::string PartsDigest::hex() {
    end();
    hash();  // the rest, if there is no thread
    return digest_.hex();
}

/// Hashes the parts until end() is called and none is left.
void PartsDigest::hash() {
    std::unique_lock lock(mutex_);
    for (;;) {
        changed_.wait(lock, [this] { return hashed_ < added_ || isEnded_; });
        if (hashed_ == added_) return;
        const std::size_t size = sizes_[hashed_ % kParts];
        lock.unlock();
        digest_.add(memoryOf(hashed_), size);
        lock.lock();
        ++hashed_;
        changed_.notify_one();
    }
}

void PartsDigest::end() {
    {
        const std::lock_guard lock(mutex_);
        isEnded_ = true;
    }
    changed_.notify_one();
    if (thread_.joinable()) thread_.join();
}

}  // namespace usdlive::resolver
