// USDLIVE_FIELDS: the one list of a message's fields, from which its encoding, its decoding and its
// row in PROTOCOL.md follow.
#pragma once

#include <array>
#include <cstddef>
#include <string_view>
#include <tuple>
#include <type_traits>

namespace usdlive {

/// Splits "one, two" into its names.
template <std::size_t count>
constexpr std::array<std::string_view, count> splitNames(std::string_view list) {
    std::array<std::string_view, count> names;
    for (std::string_view& name : names) {
        name = list.substr(0, list.find(','));
        list.remove_prefix(name.size());
        const std::size_t next = list.find_first_not_of(", ");
        list.remove_prefix(next == list.npos ? list.size() : next);
    }
    return names;
}

/// A struct with USDLIVE_FIELDS.
template <class T>
concept HasFields = requires { T::kFieldNames; };

/// Calls `visit(name, field)` for each listed field, in order.
template <class T, class Visit>
    requires HasFields<std::remove_const_t<T>>
constexpr void forEachField(T& message, Visit&& visit) {
    std::apply(
        [&](auto&... fields) {
            constexpr auto names = splitNames<sizeof...(fields)>(T::kFieldNames);
            std::size_t index = 0;
            (visit(names[index++], fields), ...);
        },
        message.fields());
}

}  // namespace usdlive

/// Lists the fields of a struct under the names that they have in JSON. Stands behind the fields.
#define USDLIVE_FIELDS(...)                                       \
    static constexpr std::string_view kFieldNames = #__VA_ARGS__; \
    constexpr auto fields() { return std::tie(__VA_ARGS__); }     \
    constexpr auto fields() const { return std::tie(__VA_ARGS__); }
