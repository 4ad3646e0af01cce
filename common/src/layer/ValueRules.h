#pragma once

#include "usdlive/common/layer/Value.h"

namespace usdlive {

/// What speaks against some bytes, to follow "the value ...": "ends too early". nullptr: nothing.
using Problem = const char*;

/// V1-V8 for the bytes of a leaf.
[[nodiscard]] Problem problemOfLeaf(ValueType type, ByteView bytes);

/// V9-V10 for an encoded field, whole. Needs no memory but for telling a Map's keys apart.
[[nodiscard]] Problem problemOfField(ByteView bytes);

}  // namespace usdlive
