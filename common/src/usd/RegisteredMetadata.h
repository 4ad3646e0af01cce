// Handles metadata that no plug-in declares.
#pragma once

#include <pxr/base/vt/value.h>
#include <pxr/usd/sdf/path.h>
#include <pxr/usd/sdf/types.h>

namespace usdlive::usd {

/// Returns `value` as the text format would read it here. A metadata field that no plug-in declares
/// is read as its text (SdfUnregisteredValue). If a plug-in declares the field, the text is read as
/// the declared type. Otherwise, or if the text is not of that type, returns `value` unchanged.
[[nodiscard]] pxr::VtValue asRegistered(const pxr::SdfPath& path, const pxr::TfToken& field,
                                        pxr::VtValue value);

}  // namespace usdlive::usd
