// A SHA-256 hash as a value, and its text form.
#pragma once

#include <array>
#include <compare>
#include <cstdint>
#include <initializer_list>
#include <optional>
#include <string>
#include <string_view>

#include "usdlive/common/core/Bytes.h"

namespace usdlive {

/// A SHA-256. It names big values by their content and chains commits.
struct Hash {
    std::array<std::uint8_t, 32> bytes{};

    auto operator<=>(const Hash&) const = default;
    /// Returns 64 lower-case hexadecimal digits.
    [[nodiscard]] std::string hex() const;
};

/// Parses the result of Hash::hex(). Returns nothing for any other text, also for upper-case
/// digits.
[[nodiscard]] std::optional<Hash> hashFromHex(std::string_view text);

/// Returns the SHA-256 of the concatenated parts.
[[nodiscard]] Hash sha256(std::initializer_list<ByteView> parts);
[[nodiscard]] inline Hash sha256(ByteView bytes) { return sha256({bytes}); }

}  // namespace usdlive

template <>
struct std::hash<usdlive::Hash> {
    std::size_t operator()(const usdlive::Hash& hash) const noexcept;
};
