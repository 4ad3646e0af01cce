// Interpolates between two values of any type that OpenUSD interpolates.
#include "usd/stage/Interpolate.h"

#include <pxr/base/gf/math.h>
#include <pxr/base/gf/matrix2d.h>
#include <pxr/base/gf/matrix3d.h>
#include <pxr/base/gf/matrix4d.h>
#include <pxr/base/gf/quatd.h>
#include <pxr/base/gf/quatf.h>
#include <pxr/base/gf/quath.h>
#include <pxr/base/gf/timeCode.h>
#include <pxr/base/gf/vec2d.h>
#include <pxr/base/gf/vec2f.h>
#include <pxr/base/gf/vec2h.h>
#include <pxr/base/gf/vec3d.h>
#include <pxr/base/gf/vec3f.h>
#include <pxr/base/gf/vec3h.h>
#include <pxr/base/gf/vec4d.h>
#include <pxr/base/gf/vec4f.h>
#include <pxr/base/gf/vec4h.h>
#include <pxr/base/vt/array.h>
#include <pxr/base/vt/typeHeaders.h>
#include <pxr/base/vt/types.h>

#include <array>
#include <concepts>

namespace usdlive::stage {

using pxr::VtArray;
using pxr::VtValue;

namespace {

template <class T, class... Others>
concept OneOf = (std::same_as<T, Others> || ...);

template <class T>
T between(double fraction, const T& lower, const T& upper) {
    if constexpr (OneOf<T, pxr::GfQuath, pxr::GfQuatf, pxr::GfQuatd>)
        return pxr::GfSlerp(fraction, lower, upper);
    else
        return pxr::GfLerp(fraction, lower, upper);
}

template <class T>
VtValue one(const VtValue& lower, const VtValue& upper, double fraction) {
    return VtValue(between(fraction, lower.UncheckedGet<T>(), upper.UncheckedGet<T>()));
}

template <class T>
VtValue each(const VtValue& lower, const VtValue& upper, double fraction) {
    const auto& from = lower.UncheckedGet<VtArray<T>>();
    const auto& to = upper.UncheckedGet<VtArray<T>>();
    if (from.size() != to.size() || fraction == 0) return lower;
    if (fraction == 1) return upper;
    VtArray<T> result;
    const T* left = from.cdata();
    const T* right = to.cdata();
    result.resize(from.size(), [&](T* begin, T* end) {
        for (T* item = begin; item != end; ++item, ++left, ++right)
            new (item) T(between(fraction, *left, *right));
    });
    return VtValue::Take(result);
}

using Interpolator = VtValue (*)(const VtValue&, const VtValue&, double);
using Interpolators = std::array<Interpolator, pxr::VtGetNumKnownValueTypes()>;

template <class... Types>
constexpr Interpolators interpolatorsOf() {
    Interpolators all{};
    ((all[pxr::VtGetKnownValueTypeIndex<Types>()] = one<Types>,
      all[pxr::VtGetKnownValueTypeIndex<VtArray<Types>>()] = each<Types>),
     ...);
    return all;
}

Interpolator interpolatorFor(const VtValue& value) {
    static constexpr Interpolators kInterpolators =
        interpolatorsOf<pxr::GfHalf, float, double, pxr::GfTimeCode, pxr::GfMatrix2d,
                        pxr::GfMatrix3d, pxr::GfMatrix4d, pxr::GfVec2d, pxr::GfVec2f, pxr::GfVec2h,
                        pxr::GfVec3d, pxr::GfVec3f, pxr::GfVec3h, pxr::GfVec4d, pxr::GfVec4f,
                        pxr::GfVec4h, pxr::GfQuatd, pxr::GfQuatf, pxr::GfQuath>();
    const int index = value.GetKnownValueTypeIndex();
    return index < 0 ? nullptr : kInterpolators[std::size_t(index)];
}

}  // namespace

bool canInterpolate(const VtValue& value) { return interpolatorFor(value) != nullptr; }

bool isBlock(const VtValue& value) {
    return value.IsHolding<pxr::SdfValueBlock>() || value.IsHolding<pxr::SdfAnimationBlock>();
}

VtValue interpolate(const VtValue& lower, const VtValue& upper, double fraction) {
    const auto interpolator = interpolatorFor(lower);
    if (!interpolator) return lower;
    const bool sameType = lower.GetTypeid() == upper.GetTypeid();
    return interpolator(lower, sameType ? upper : lower, fraction);
}

}  // namespace usdlive::stage
