// Writes and reads the bytes of compact frames (FR9-FR11).
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <utility>

#include "Decoding.h"
#include "usdlive/common/core/ByteStream.h"
#include "usdlive/common/protocol/Frame.h"

namespace usdlive::compact {

/// The first byte of a frame. The first byte of other frames is a multiple of 4.
enum class Kind : std::uint8_t { Submit = 1, Commit = 3, Acceptance = 5, Preview = 7, Names = 9 };

enum class Action : std::uint8_t { Create, Delete, Move, Place, Set, Erase };
enum class PartKind : std::uint8_t { None, DictionaryKey, SampleTime, ListItem, MapKey };

// The first byte of an edit: the action, the part, and what follows.
inline constexpr unsigned kPartShift = 3, kFieldMask = 7;
inline constexpr std::uint8_t kOtherLayer = 0x40, kHasCreation = 0x80;
// The first byte of a list item: the list, and what follows.
inline constexpr std::uint8_t kListMask = 0x3f, kHasForm = 0x40, kHasBefore = 0x80;

inline constexpr std::size_t kPreviousBytes = 8;
inline constexpr std::size_t kMaxShared = 255;  // bytes of a path that are those of the one before

/// Writes a frame with its length in front.
class BytesOut {
public:
    explicit BytesOut(Kind kind) : out_(sizeof(std::uint32_t)) { u8(std::uint8_t(kind)); }

    void u8(std::uint8_t value) { out_.push_back(value); }
    void f64(double value) { appendNumber<double>(out_, value); }
    void bytes(ByteView value) { appendBytes(out_, value); }
    /// Seven bits a byte, the lowest first; the highest bit of a byte: more follow.
    void varint(std::uint64_t value) {
        for (; value > 0x7f; value >>= 7) u8(std::uint8_t(value) | 0x80);
        u8(std::uint8_t(value));
    }
    [[nodiscard]] std::size_t size() const { return out_.size(); }

    [[nodiscard]] Bytes finish() {
        constexpr std::size_t kPrefix = sizeof(std::uint32_t);
        if (out_.size() < kPrefix + kMinFrameBytes) out_.resize(kPrefix + kMinFrameBytes);
        const auto length = std::uint32_t(out_.size() - kPrefix);
        std::memcpy(out_.data(), &length, sizeof length);
        return std::move(out_);
    }

private:
    Bytes out_;
};

/// Reads untrusted bytes. Throws Undecodable.
class BytesIn {
public:
    explicit BytesIn(ByteView frame) : frame_(frame), bytes_(frame) {}

    std::uint8_t u8() { return checked(bytes_.u8()); }
    double f64() { return checked(bytes_.f64()); }
    ByteView take(std::uint64_t size) { return checked(bytes_.take(size)); }
    std::uint64_t varint() {
        std::uint64_t value = 0;
        for (unsigned shift = 0; shift < 64; shift += 7) {
            const std::uint64_t byte = u8();
            require(shift < 63 || byte <= 1, "a number has more than 64 bits");
            value |= (byte & 0x7f) << shift;
            if (byte < 0x80) break;
        }
        return value;
    }
    /// Reads a number of things, each of at least `bytes`.
    std::size_t count(std::size_t most, std::size_t bytes) {
        const std::uint64_t count = varint();
        require(count <= most && count * bytes <= bytes_.left(), "a frame has too many parts");
        return std::size_t(count);
    }
    std::uint32_t u32() {
        const std::uint64_t value = varint();
        require(value <= UINT32_MAX, "a number has more than 32 bits");
        return std::uint32_t(value);
    }
    Hash hash(std::size_t size = sizeof(Hash)) {
        Hash hash{};
        const ByteView bytes = take(size);
        std::copy(bytes.begin(), bytes.end(), hash.bytes.begin());
        return hash;
    }
    /// Checks that nothing follows but what makes a frame long enough.
    void finish() {
        require(frame_.size() == kMinFrameBytes || bytes_.left() == 0,
                "a frame continues after its end");
        while (bytes_.left() > 0) require(u8() == 0, "a frame continues after its end");
    }

private:
    template <class T>
    T checked(T value) const {
        require(!bytes_.failed(), "a frame ends too early");
        return value;
    }

    ByteView frame_;
    ByteReader bytes_;
};

}  // namespace usdlive::compact
