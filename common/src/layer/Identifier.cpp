// Recognizes identifiers as OpenUSD defines them, with tables of Unicode.
#include "Identifier.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <iterator>

#include "IdentifierRanges.h"
#include "usdlive/common/core/Utf8.h"

namespace usdlive {

namespace {

enum : std::uint8_t { kStart = 1, kContinue = 2, kVariant = 4 };

constexpr std::array<std::uint8_t, 128> makeAscii() {
    std::array<std::uint8_t, 128> classes{};
    for (std::size_t c = 'a'; c <= 'z'; ++c) classes[c] = kStart | kContinue | kVariant;
    for (std::size_t c = 'A'; c <= 'Z'; ++c) classes[c] = kStart | kContinue | kVariant;
    for (std::size_t c = '0'; c <= '9'; ++c) classes[c] = kContinue | kVariant;
    classes['_'] = kStart | kContinue | kVariant;
    classes['|'] = classes['-'] = kVariant;
    return classes;
}
constexpr auto kAscii = makeAscii();

template <std::size_t N>
bool isIn(const CodePointRange (&ranges)[N], char32_t point) {
    const auto* after =
        std::upper_bound(std::begin(ranges), std::end(ranges), point,
                         [](char32_t p, const CodePointRange& range) { return p < range.first; });
    return after != std::begin(ranges) && point <= std::prev(after)->last;
}

// Removes one character of the class from the text. Returns false if the text does not begin with
// one.
bool take(std::string_view& text, std::uint8_t wanted) {
    if (text.empty()) return false;
    const auto first = static_cast<unsigned char>(text.front());
    if (first < kAscii.size()) {
        if ((kAscii[first] & wanted) == 0) return false;
        text.remove_prefix(1);
        return true;
    }
    const auto point = takeCodePoint(text);
    return point &&
           (wanted == kStart ? isIn(kIdentifierStart, *point) : isIn(kIdentifierContinue, *point));
}

// Returns true if the whole text is of the class. Names are nearly always ASCII, for which the
// table is enough.
bool isAll(std::string_view text, std::uint8_t wanted) {
    while (!text.empty()) {
        std::size_t ascii = 0;
        while (ascii < text.size()) {
            const auto byte = static_cast<unsigned char>(text[ascii]);
            if (byte >= kAscii.size()) break;
            if ((kAscii[byte] & wanted) == 0) return false;
            ++ascii;
        }
        text.remove_prefix(ascii);
        if (!text.empty() && !take(text, wanted)) return false;
    }
    return true;
}

}  // namespace

bool isIdentifier(std::string_view text) { return take(text, kStart) && isAll(text, kContinue); }

bool isPropertyName(std::string_view text) {
    while (true) {
        const std::size_t colon = text.find(':');
        if (!isIdentifier(text.substr(0, colon))) return false;
        if (colon == std::string_view::npos) return true;
        text.remove_prefix(colon + 1);
    }
}

bool isVariantName(std::string_view text) {
    if (text.empty()) return false;
    if (text.front() == '.') text.remove_prefix(1);
    return isAll(text, kVariant);
}

}  // namespace usdlive
