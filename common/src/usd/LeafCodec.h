// Converts single USD values to bytes and back.
#pragma once

#include <pxr/base/vt/value.h>
#include <pxr/usd/sdf/path.h>

#include <typeinfo>

#include "usdlive/common/usd/ValueCodec.h"

namespace usdlive::usd {

/// Returns true for list ops. Their items are leaves and never blobs.
[[nodiscard]] bool isListOp(const std::type_info& type);
/// Precondition: `value` holds a list op.
[[nodiscard]] Result<ListOp> encodeListOp(const pxr::VtValue& value);
[[nodiscard]] Result<pxr::VtValue> decodeListOp(const ListOp& list);

/// Returns true if both values are identical for the text format and the wire, unlike `==`, for
/// which -0.0 equals 0.0. Compares dictionaries and time samples item by item. For all values that
/// are no leaves `==` decides.
[[nodiscard]] bool areIdentical(const pxr::VtValue& left, const pxr::VtValue& right);

/// Returns an absolute or empty path if this OpenUSD writes it as exactly this text, otherwise
/// InvalidValue.
[[nodiscard]] Result<pxr::SdfPath> parsePath(std::string_view text);

}  // namespace usdlive::usd
