// The numbers inside the bytes of a value (V2, V3), and the type names that the commands print.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "usdlive/common/core/ByteStream.h"
#include "usdlive/common/layer/FieldValue.h"

namespace usdlive::cli {

/// The names of edit actions and of the lists of a list op, by index.
inline constexpr std::array<std::string_view, 6> kActionNames{"create", "delete", "move",
                                                              "place",  "set",    "erase"};
inline constexpr std::array<std::string_view, kListNames> kListOpNames{
    "explicit", "added", "prepended", "appended", "deleted", "ordered"};

/// Returns a Specifier, Variability or Permission as in .usda. Nothing for other types and invalid
/// bytes.
[[nodiscard]] std::optional<std::string_view> enumText(ValueType type, ByteView bytes);

/// The type of one number inside a value.
enum class Element { None, Bool, UChar, Int, UInt, Int64, UInt64, Half, Float, Double };

/// A type's name in .usda, and the numbers of one value.
struct Shape {
    std::string_view name;
    Element element = Element::None;  ///< None: it has no numbers
    int count = 0;                    ///< the number of numbers
    int row = 0;                      ///< numbers per row of a matrix; otherwise 0
};

/// Returns the shape for a leaf's type without the flags for arrays and array edits.
[[nodiscard]] Shape shapeOf(ValueType scalar);

[[nodiscard]] constexpr ValueType scalarOf(ValueType type) {
    return ValueType(std::uint16_t(type) & 0xff);
}
[[nodiscard]] constexpr bool isArrayEdit(ValueType type) {
    return (std::uint16_t(type) & std::uint16_t(ValueType::ArrayEditFlag)) != 0;
}
[[nodiscard]] constexpr bool isArray(ValueType type) {
    return (std::uint16_t(type) & std::uint16_t(ValueType::ArrayFlag)) != 0;
}

/// Reads the next number and calls `use` with it as bool, integer, float or double.
template <class Use>
auto readElement(ByteReader& bytes, Element element, Use&& use);

[[nodiscard]] float halfToFloat(std::uint16_t half);

/// Return the shortest text that reads back as the same number.
[[nodiscard]] std::string number(float value);
[[nodiscard]] std::string number(double value);
[[nodiscard]] std::string number(std::uint64_t value);
[[nodiscard]] std::string number(std::int64_t value);
[[nodiscard]] inline std::string number(std::int32_t value) { return number(std::int64_t(value)); }
[[nodiscard]] inline std::string number(std::uint32_t value) {
    return number(std::uint64_t(value));
}
[[nodiscard]] inline std::string number(bool value) { return value ? "true" : "false"; }

template <class Use>
auto readElement(ByteReader& bytes, Element element, Use&& use) {
    switch (element) {
        case Element::Bool:
            return use(bytes.u8() != 0);
        case Element::UChar:
            return use(std::uint32_t(bytes.u8()));
        case Element::Int:
            return use(bytes.number<std::int32_t>());
        case Element::UInt:
            return use(bytes.u32());
        case Element::Int64:
            return use(bytes.i64());
        case Element::UInt64:
            return use(bytes.u64());
        case Element::Half:
            return use(halfToFloat(bytes.u16()));
        case Element::Float:
            return use(bytes.number<float>());
        default:
            return use(bytes.f64());
    }
}

}  // namespace usdlive::cli
