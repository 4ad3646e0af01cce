// Checks the bytes of values.
#pragma once

#include "usdlive/common/layer/Value.h"

namespace usdlive {

/// The problem of some bytes as the end of a sentence, "the value ...": "ends too early". nullptr
/// if there is none.
using Problem = const char*;

/// Checks the bytes of a leaf against V1-V8. Sets `holdsNul`, if given, when a text or key in it
/// holds a NUL.
[[nodiscard]] Problem problemOfLeaf(ValueType type, ByteView bytes, bool* holdsNul = nullptr);

/// Checks a whole encoded field against V9-V10. Needs memory only to compare the keys of a Map.
[[nodiscard]] Problem problemOfField(ByteView bytes);

}  // namespace usdlive
