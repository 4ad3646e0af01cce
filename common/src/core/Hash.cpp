#include "usdlive/common/core/Hash.h"

#include <cstring>

#include "usdlive/common/core/Sha256.h"

namespace usdlive {

std::string Hash::hex() const {
    static constexpr char kDigits[] = "0123456789abcdef";
    std::string text;
    text.reserve(2 * bytes.size());
    for (const std::uint8_t byte : bytes) {
        text += kDigits[byte >> 4];
        text += kDigits[byte & 15];
    }
    return text;
}

Hash sha256(std::initializer_list<ByteView> parts) {
    Sha256 sum;
    for (const ByteView part : parts) sum.add(part);
    return sum.finish();
}

}  // namespace usdlive

std::size_t std::hash<usdlive::Hash>::operator()(const usdlive::Hash& hash) const noexcept {
    std::size_t first = 0;  // any part of a SHA-256 is as good as the whole
    std::memcpy(&first, hash.bytes.data(), sizeof first);
    return first;
}
