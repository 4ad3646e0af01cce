// Parses the header Range of a request.
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

namespace usdlive::server {

/// The bytes [begin, end).
struct ByteRange {
    std::uint64_t begin = 0, end = 0;
    bool operator==(const ByteRange&) const = default;
};

/// Returns the range of a content of `size` bytes that a header such as `bytes=0-99` asks for. An
/// empty range: it is outside the content. Nothing: the header is ignored, because it is malformed,
/// has another unit, or asks for several ranges (RFC 9110 allows that).
[[nodiscard]] std::optional<ByteRange> parseByteRange(std::string_view header, std::uint64_t size);

}  // namespace usdlive::server
