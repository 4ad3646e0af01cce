#pragma once

#include <pxr/base/vt/value.h>
#include <pxr/usd/sdf/path.h>
#include <pxr/usd/sdf/types.h>

namespace usdlive::usd {

/// A metadata field that no plug-in declares is read from a text as its text
/// (SdfUnregisteredValue). Where a plug-in declares the field, returns what reading the text there
/// gives; `value` itself where none does, or where the text is none of the declared type.
[[nodiscard]] pxr::VtValue asRegistered(const pxr::SdfPath& path, const pxr::TfToken& field,
                                        pxr::VtValue value);

}  // namespace usdlive::usd
