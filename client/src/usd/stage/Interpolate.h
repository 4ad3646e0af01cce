// Declares the rules for time samples: which times are one, blocks, and interpolation.
#pragma once

#include <pxr/base/vt/value.h>

namespace usdlive::stage {

/// Times that are closer than this are one time.
inline constexpr double kSameTime = 1e-6;

/// Returns true for a value that blocks weaker ones.
[[nodiscard]] bool isBlock(const pxr::VtValue& value);

/// Returns the value between two time samples of one type. `fraction` is 0 at `lower` and 1 at
/// `upper`. Interpolates linearly for real numbers, vectors, matrices, time codes and arrays of
/// them with equal sizes; on the sphere for quaternions. Returns `lower` for all other types.
[[nodiscard]] pxr::VtValue interpolate(const pxr::VtValue& lower, const pxr::VtValue& upper,
                                       double fraction);

/// Returns true if interpolate() uses the upper value for values of this type.
[[nodiscard]] bool canInterpolate(const pxr::VtValue& value);

}  // namespace usdlive::stage
