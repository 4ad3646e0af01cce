#pragma once

#include <pxr/base/vt/value.h>
#include <pxr/usd/sdf/path.h>

#include <typeinfo>

#include "usdlive/common/usd/ValueCodec.h"

namespace usdlive::usd {

/// List ops, whose items are leaves and never blobs.
[[nodiscard]] bool isListOp(const std::type_info& type);
/// Precondition: it holds a list op.
[[nodiscard]] Result<ListOp> encodeListOp(const pxr::VtValue& value);
[[nodiscard]] Result<pxr::VtValue> decodeListOp(const ListOp& list);

/// Are the two the same to others, too? `==` takes -0.0 for 0.0, and text and wire do not. Looks
/// into dictionaries and time samples; of what is no leaf `==` decides.
[[nodiscard]] bool areIdentical(const pxr::VtValue& left, const pxr::VtValue& right);

/// An absolute path, or the empty one, if this OpenUSD writes it as exactly this text; InvalidValue
/// otherwise.
[[nodiscard]] Result<pxr::SdfPath> parsePath(std::string_view text);

}  // namespace usdlive::usd
