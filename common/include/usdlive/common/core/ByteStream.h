// Reads and writes numbers and text as bytes.
#pragma once

#include <bit>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string_view>
#include <type_traits>

#include "usdlive/common/core/Bytes.h"

namespace usdlive {

static_assert(std::endian::native == std::endian::little, "bytes are copied as they are in memory");

template <class T>
concept Number = std::integral<T> || std::floating_point<T>;

/// Reads little-endian numbers and length-prefixed text from untrusted bytes. A read past the end
/// returns zero or an empty view and sets `failed()`, which then stays set.
class ByteReader {
public:
    explicit ByteReader(ByteView bytes) : rest_(bytes) {}

    template <Number T>
    T number() {
        T value{};
        const ByteView bytes = take(sizeof(T));
        if (!bytes.empty()) std::memcpy(&value, bytes.data(), sizeof(T));
        return value;
    }
    std::uint8_t u8() { return number<std::uint8_t>(); }
    std::uint16_t u16() { return number<std::uint16_t>(); }
    std::uint32_t u32() { return number<std::uint32_t>(); }
    std::uint64_t u64() { return number<std::uint64_t>(); }
    std::int64_t i64() { return number<std::int64_t>(); }
    double f64() { return number<double>(); }

    /// Returns the next `size` bytes. If there are fewer, returns an empty view and sets failed().
    ByteView take(std::uint64_t size) {
        if (size > rest_.size()) {
            failed_ = true;
            rest_ = {};
            return {};
        }
        const ByteView taken = rest_.first(std::size_t(size));
        rest_ = rest_.subspan(std::size_t(size));
        return taken;
    }
    /// Reads a u32 length and that many bytes. Does not check that they are UTF-8.
    std::string_view text() { return asText(take(u32())); }

    [[nodiscard]] std::size_t left() const { return rest_.size(); }
    [[nodiscard]] bool failed() const { return failed_; }
    /// Returns true if no read failed and no byte is left over.
    [[nodiscard]] bool finished() const { return !failed_ && rest_.empty(); }

private:
    ByteView rest_;
    bool failed_ = false;
};

template <Number T>
void appendNumber(Bytes& out, std::type_identity_t<T> value) {
    const auto* at = reinterpret_cast<const std::uint8_t*>(&value);
    out.insert(out.end(), at, at + sizeof(T));
}
inline void appendBytes(Bytes& out, ByteView bytes) {
    out.insert(out.end(), bytes.begin(), bytes.end());
}
/// Appends a u32 length, then the bytes. Precondition: `text` is shorter than 4 GiB.
inline void appendText(Bytes& out, std::string_view text) {
    appendNumber<std::uint32_t>(out, std::uint32_t(text.size()));
    appendBytes(out, asBytes(text));
}

}  // namespace usdlive
