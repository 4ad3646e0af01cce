// Computes SHA-256 hashes and converts them to and from hexadecimal text.
#include "usdlive/common/core/Hash.h"

#include <cstring>

#include "usdlive/common/core/Sha256.h"

namespace usdlive {

namespace {

constexpr std::string_view kDigits = "0123456789abcdef";

}  // namespace

std::string Hash::hex() const {
    std::string text;
    text.reserve(2 * bytes.size());
    for (const std::uint8_t byte : bytes) {
        text += kDigits[byte >> 4];
        text += kDigits[byte & 15];
    }
    return text;
}

std::optional<Hash> hashFromHex(std::string_view text) {
    Hash hash;
    if (text.size() != 2 * hash.bytes.size()) return std::nullopt;
    for (std::size_t index = 0; index < text.size(); ++index) {
        const auto digit = kDigits.find(text[index]);
        if (digit == kDigits.npos) return std::nullopt;
        hash.bytes[index / 2] = std::uint8_t(hash.bytes[index / 2] << 4 | digit);
    }
    return hash;
}

Hash sha256(std::initializer_list<ByteView> parts) {
    Sha256 sum;
    for (const ByteView part : parts) sum.add(part);
    return sum.finish();
}

}  // namespace usdlive

std::size_t std::hash<usdlive::Hash>::operator()(const usdlive::Hash& hash) const noexcept {
    std::size_t first = 0;  // any part of a SHA-256 is equally well distributed
    std::memcpy(&first, hash.bytes.data(), sizeof first);
    return first;
}
