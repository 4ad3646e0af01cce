// Converts values between the times of layers and combines list ops.
#pragma once

#include <pxr/base/vt/value.h>
#include <pxr/usd/sdf/layerOffset.h>

namespace usdlive::content {

/// Converts a field's value to the time of another layer; `times` is the offset between the two.
/// Converts time codes, time samples, splines, and offsets of references and payloads, also in
/// dictionaries.
[[nodiscard]] pxr::VtValue mapped(const pxr::VtValue& value, const pxr::SdfLayerOffset& times);

/// Returns true if the value contains the path of an asset, which may be relative to its layer.
[[nodiscard]] bool hasAssetPath(const pxr::VtValue& value);

/// Returns a list op combined with a weaker one. Empty for other values.
[[nodiscard]] pxr::VtValue composedListOp(const pxr::VtValue& stronger, const pxr::VtValue& weaker);
[[nodiscard]] bool isListOp(const pxr::VtValue& value);

}  // namespace usdlive::content
