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

/// A SHA-256: names big values by their content and chains commits.
struct Hash {
    std::array<std::uint8_t, 32> bytes{};

    auto operator<=>(const Hash&) const = default;
    /// 64 lower-case hexadecimal digits.
    [[nodiscard]] std::string hex() const;
};

/// What Hash::hex() gave; nothing: the text is not that, or has capital digits.
[[nodiscard]] std::optional<Hash> hashFromHex(std::string_view text);

/// The SHA-256 of the parts one after the other.
[[nodiscard]] Hash sha256(std::initializer_list<ByteView> parts);
[[nodiscard]] inline Hash sha256(ByteView bytes) { return sha256({bytes}); }

}  // namespace usdlive

template <>
struct std::hash<usdlive::Hash> {
    std::size_t operator()(const usdlive::Hash& hash) const noexcept;
};
