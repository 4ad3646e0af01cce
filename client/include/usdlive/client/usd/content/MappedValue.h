#pragma once

#include <pxr/base/vt/value.h>
#include <pxr/usd/sdf/layerOffset.h>

namespace usdlive::content {

/// A field's value as another layer has to say it, `times` from the one's time to the other's: time
/// codes, time samples, splines, and offsets of references and payloads, also within dictionaries.
[[nodiscard]] pxr::VtValue mapped(const pxr::VtValue& value, const pxr::SdfLayerOffset& times);

/// A list op laid over a weaker one, as one; nothing for other values.
[[nodiscard]] pxr::VtValue composedListOp(const pxr::VtValue& stronger, const pxr::VtValue& weaker);
[[nodiscard]] bool isListOp(const pxr::VtValue& value);

}  // namespace usdlive::content
