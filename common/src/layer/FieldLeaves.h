// Visits the values that a field consists of.
#pragma once

#include <functional>

#include "usdlive/common/layer/FieldValue.h"

namespace usdlive {

/// Calls `visit` for the value itself, or for each value in the composite: entries of dictionaries,
/// samples, items of lists, keys and values of maps.
void forEachLeaf(const FieldValue& field, const std::function<void(const Value&)>& visit);

}  // namespace usdlive
