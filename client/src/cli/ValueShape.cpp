// Names the types of values and reads the numbers in them.
#include "cli/ValueShape.h"

#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <span>

namespace usdlive::cli {

namespace {

template <class T>
std::string shortest(T value) {
    char digits[32];
    const auto end = std::to_chars(std::begin(digits), std::end(digits), value).ptr;
    return {digits, end};
}

struct Row {
    ValueType type;
    Shape shape;
};

constexpr std::array kShapes{
    Row{ValueType::None, {"none"}},
    Row{ValueType::Bool, {"bool", Element::Bool, 1}},
    Row{ValueType::UChar, {"uchar", Element::UChar, 1}},
    Row{ValueType::Int, {"int", Element::Int, 1}},
    Row{ValueType::UInt, {"uint", Element::UInt, 1}},
    Row{ValueType::Int64, {"int64", Element::Int64, 1}},
    Row{ValueType::UInt64, {"uint64", Element::UInt64, 1}},
    Row{ValueType::Half, {"half", Element::Half, 1}},
    Row{ValueType::Float, {"float", Element::Float, 1}},
    Row{ValueType::Double, {"double", Element::Double, 1}},
    Row{ValueType::TimeCode, {"timecode", Element::Double, 1}},
    Row{ValueType::String, {"string"}},
    Row{ValueType::Token, {"token"}},
    Row{ValueType::Asset, {"asset"}},
    Row{ValueType::PathExpression, {"pathExpression"}},
    Row{ValueType::Path, {"path"}},
    Row{ValueType::Opaque, {"opaque"}},
    Row{ValueType::Matrix2d, {"matrix2d", Element::Double, 4, 2}},
    Row{ValueType::Matrix3d, {"matrix3d", Element::Double, 9, 3}},
    Row{ValueType::Matrix4d, {"matrix4d", Element::Double, 16, 4}},
    Row{ValueType::Quath, {"quath", Element::Half, 4}},
    Row{ValueType::Quatf, {"quatf", Element::Float, 4}},
    Row{ValueType::Quatd, {"quatd", Element::Double, 4}},
    Row{ValueType::Int2, {"int2", Element::Int, 2}},
    Row{ValueType::Half2, {"half2", Element::Half, 2}},
    Row{ValueType::Float2, {"float2", Element::Float, 2}},
    Row{ValueType::Double2, {"double2", Element::Double, 2}},
    Row{ValueType::Int3, {"int3", Element::Int, 3}},
    Row{ValueType::Half3, {"half3", Element::Half, 3}},
    Row{ValueType::Float3, {"float3", Element::Float, 3}},
    Row{ValueType::Double3, {"double3", Element::Double, 3}},
    Row{ValueType::Int4, {"int4", Element::Int, 4}},
    Row{ValueType::Half4, {"half4", Element::Half, 4}},
    Row{ValueType::Float4, {"float4", Element::Float, 4}},
    Row{ValueType::Double4, {"double4", Element::Double, 4}},
    Row{ValueType::Block, {"None"}},
    Row{ValueType::AnimationBlock, {"AnimationBlock"}},
    Row{ValueType::Spline, {"spline"}},
    Row{ValueType::Specifier, {"specifier"}},
    Row{ValueType::Variability, {"variability"}},
    Row{ValueType::Permission, {"permission"}},
    Row{ValueType::TokenVector, {"tokens"}},
    Row{ValueType::StringVector, {"strings"}},
    Row{ValueType::Reference, {"reference"}},
    Row{ValueType::Payload, {"payload"}},
    Row{ValueType::SubLayer, {"sublayer"}},
    Row{ValueType::Unregistered, {"unregistered"}},
    Row{ValueType::LayerOffset, {"offset", Element::Double, 2}},
    Row{ValueType::Dictionary, {"dictionary"}},
    Row{ValueType::TimeSamples, {"timeSamples"}},
    Row{ValueType::ListOp, {"listOp"}},
    Row{ValueType::Map, {"map"}},
};

}  // namespace

Shape shapeOf(ValueType scalar) {
    const auto found = std::ranges::find(kShapes, scalar, &Row::type);
    return found == kShapes.end() ? Shape{"value"} : found->shape;
}

std::optional<std::string_view> enumText(ValueType type, ByteView bytes) {
    constexpr std::array<std::string_view, 3> kSpecifiers{"def", "over", "class"};
    constexpr std::array<std::string_view, 2> kVariabilities{"varying", "uniform"};
    constexpr std::array<std::string_view, 2> kPermissions{"public", "private"};
    std::span<const std::string_view> names;
    if (type == ValueType::Specifier) names = kSpecifiers;
    if (type == ValueType::Variability) names = kVariabilities;
    if (type == ValueType::Permission) names = kPermissions;
    if (bytes.size() != 1 || bytes[0] >= names.size()) return std::nullopt;
    return names[bytes[0]];
}

float halfToFloat(std::uint16_t half) {
    const std::uint32_t sign = std::uint32_t(half & 0x8000) << 16;
    const int exponent = (half >> 10) & 31;
    const std::uint32_t mantissa = half & 0x3ff;
    if (exponent == 0) return (sign ? -1.f : 1.f) * float(mantissa) * 0x1p-24f;
    const std::uint32_t biased = exponent == 31 ? 255u : std::uint32_t(exponent + 112);
    return std::bit_cast<float>(sign | (biased << 23) | (mantissa << 13));
}

std::string number(float value) { return shortest(value); }
std::string number(double value) { return shortest(value); }
std::string number(std::uint64_t value) { return shortest(value); }
std::string number(std::int64_t value) { return shortest(value); }

}  // namespace usdlive::cli
