// Validates UTF-8, reads code points and quotes text for messages.
#include "usdlive/common/core/Utf8.h"

#include <cstddef>
#include <cstring>

namespace usdlive {

namespace {

// Returns the length of the well-formed sequence at `at`, or 0 (Unicode, table 3-7).
std::size_t sequenceLength(const unsigned char* at, std::size_t left) {
    const auto continues = [&](std::size_t index) { return (at[index] & 0xC0) == 0x80; };
    const unsigned char lead = at[0];
    if (lead < 0x80) return 1;
    if (lead < 0xC2) return 0;
    if (lead < 0xE0) return left >= 2 && continues(1) ? 2 : 0;
    if (lead < 0xF0) {
        if (left < 3 || !continues(1) || !continues(2)) return 0;
        if (lead == 0xE0 && at[1] < 0xA0) return 0;  // overlong
        if (lead == 0xED && at[1] > 0x9F) return 0;  // surrogate
        return 3;
    }
    if (lead > 0xF4 || left < 4 || !continues(1) || !continues(2) || !continues(3)) return 0;
    if (lead == 0xF0 && at[1] < 0x90) return 0;  // overlong
    if (lead == 0xF4 && at[1] > 0x8F) return 0;  // above U+10FFFF
    return 4;
}

}  // namespace

bool isUtf8(std::string_view text) {
    const auto* at = reinterpret_cast<const unsigned char*>(text.data());
    std::size_t left = text.size();
    while (left > 0) {
        std::uint64_t eight = 0;
        if (left >= sizeof eight) {  // most text is ASCII: check eight bytes at a time
            std::memcpy(&eight, at, sizeof eight);
            if ((eight & 0x8080808080808080U) == 0) {
                at += sizeof eight;
                left -= sizeof eight;
                continue;
            }
        }
        const std::size_t length = sequenceLength(at, left);
        if (length == 0) return false;
        at += length;
        left -= length;
    }
    return true;
}

std::optional<char32_t> takeCodePoint(std::string_view& text) {
    if (text.empty()) return std::nullopt;
    const auto* at = reinterpret_cast<const unsigned char*>(text.data());
    const std::size_t length = sequenceLength(at, text.size());
    if (length == 0) return std::nullopt;
    static constexpr unsigned char kLeadBits[] = {0, 0x7F, 0x1F, 0x0F, 0x07};
    char32_t point = at[0] & kLeadBits[length];
    for (std::size_t index = 1; index < length; ++index) point = point << 6 | (at[index] & 0x3F);
    text.remove_prefix(length);
    return point;
}

std::string inQuotes(std::string_view text) {
    static constexpr std::size_t kMaxShown = 100;
    std::string out = "'";
    while (!text.empty() && out.size() <= kMaxShown) {
        const std::string_view before = text;
        const auto point = takeCodePoint(text);
        if (!point) text.remove_prefix(1);
        const bool shown = point && *point >= 0x20 && !(*point >= 0x7F && *point < 0xA0);
        out += shown ? before.substr(0, before.size() - text.size()) : "?";
    }
    return out + (text.empty() ? "'" : "...'");
}

}  // namespace usdlive
