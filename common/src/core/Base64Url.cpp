// Decodes base64url strictly. OpenSSL's decoder skips spaces, wants padding and ignores spare bits.
#include "usdlive/common/core/Base64Url.h"

#include <cstdint>

namespace usdlive {

namespace {

constexpr std::string_view kBase64Digits =
    "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-_";
constexpr unsigned kDigitBits = 6, kByteBits = 8;

}  // namespace

std::optional<Bytes> base64UrlDecoded(std::string_view text) {
    Bytes bytes;
    bytes.reserve(text.size() * kDigitBits / kByteBits);
    std::uint32_t bits = 0;
    unsigned count = 0;  // bits that are waiting
    for (const char character : text) {
        const auto digit = kBase64Digits.find(character);
        if (digit == std::string_view::npos) return std::nullopt;
        bits = bits << kDigitBits | std::uint32_t(digit);
        count += kDigitBits;
        if (count < kByteBits) continue;
        count -= kByteBits;
        bytes.push_back(std::uint8_t(bits >> count));
        bits &= (1u << count) - 1;
    }
    if (count >= kDigitBits || bits != 0) return std::nullopt;
    return bytes;
}

}  // namespace usdlive
