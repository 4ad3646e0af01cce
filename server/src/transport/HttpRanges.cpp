// Parses the header Range of a request.
#include "transport/HttpRanges.h"

#include <algorithm>
#include <charconv>

namespace usdlive::server {

namespace {

/// Returns the number that `text` is, or nothing if it is none. A number that is too large is the
/// largest one.
std::optional<std::uint64_t> rangeNumber(std::string_view text) {
    if (text.empty()) return std::nullopt;
    std::uint64_t number = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
    if (end != text.data() + text.size()) return std::nullopt;
    if (error == std::errc::result_out_of_range) return ~std::uint64_t(0);
    return error == std::errc() ? std::optional(number) : std::nullopt;
}

}  // namespace

std::optional<ByteRange> parseByteRange(std::string_view header, std::uint64_t size) {
    constexpr std::string_view kUnit = "bytes=";
    if (!header.starts_with(kUnit)) return std::nullopt;
    header.remove_prefix(kUnit.size());
    const std::size_t dash = header.find('-');
    if (dash == std::string_view::npos) return std::nullopt;
    const std::string_view from = header.substr(0, dash), to = header.substr(dash + 1);
    const auto first = rangeNumber(from), last = rangeNumber(to);
    if ((!first && !from.empty()) || (!last && !to.empty()) || (!first && !last))
        return std::nullopt;
    if (!first) return ByteRange{size - std::min(size, *last), size};  // the last bytes
    if (last && *last < *first) return std::nullopt;
    if (*first >= size) return ByteRange{0, 0};
    return ByteRange{*first, last ? std::min(size - 1, *last) + 1 : size};
}

}  // namespace usdlive::server
