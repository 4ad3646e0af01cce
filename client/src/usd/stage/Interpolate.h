#pragma once

#include <pxr/base/vt/value.h>

namespace usdlive::stage {

/// Between two time samples of one type, `fraction` from 0 to 1 of the way from the lower to the
/// upper one: linear for real numbers, vectors, matrices and time codes, and for arrays of them of
/// one size; on the sphere for quaternions. The lower one for all others.
[[nodiscard]] pxr::VtValue interpolate(const pxr::VtValue& lower, const pxr::VtValue& upper,
                                       double fraction);

/// Whether interpolate() looks at the upper one at all.
[[nodiscard]] bool canInterpolate(const pxr::VtValue& value);

}  // namespace usdlive::stage
