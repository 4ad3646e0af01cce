// Encodes and decodes the path of a URL.
#include "usdlive/common/core/PercentEncoding.h"

namespace usdlive {

namespace {

std::optional<int> hexDigit(char c) {
    if (c >= '0' && c <= '9') return c - '0';
    if (c >= 'a' && c <= 'f') return c - 'a' + 10;
    if (c >= 'A' && c <= 'F') return c - 'A' + 10;
    return std::nullopt;
}

}  // namespace

std::optional<std::string> percentDecoded(std::string_view text) {
    std::string decoded;
    for (std::size_t i = 0; i < text.size(); ++i) {
        if (text[i] != '%') {
            decoded += text[i];
            continue;
        }
        if (i + 2 >= text.size()) return std::nullopt;
        const auto high = hexDigit(text[i + 1]);
        const auto low = hexDigit(text[i + 2]);
        if (!high || !low) return std::nullopt;
        decoded += char(*high * 16 + *low);
        i += 2;
    }
    return decoded;
}

std::string percentEncoded(std::string_view text) {
    return percentEncodedIf(text, [](char c) {
        const auto byte = static_cast<unsigned char>(c);
        return c == '%' || c == '?' || c == '#' || byte <= ' ' || byte == 0x7f;
    });
}

std::string percentEncodedIf(std::string_view text, bool (*isEncoded)(char)) {
    constexpr std::string_view kDigits = "0123456789ABCDEF";
    std::string encoded;
    for (const char c : text) {
        if (!isEncoded(c)) {
            encoded += c;
            continue;
        }
        const auto byte = static_cast<unsigned char>(c);
        encoded += '%';
        encoded += kDigits[byte >> 4];
        encoded += kDigits[byte & 15];
    }
    return encoded;
}

}  // namespace usdlive
