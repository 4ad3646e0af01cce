// Finds the big values (V9) that an encoded commit names.
#pragma once

#include <functional>

#include "usdlive/common/core/Bytes.h"
#include "usdlive/common/core/Hash.h"
#include "usdlive/common/core/Result.h"

namespace usdlive {

/// Calls `visit` for every big value that an encoded commit names, also in its dropped edits. Reads
/// one value at a time. Errors: MalformedFrame, InvalidValue.
[[nodiscard]] Result<void> forEachBlob(ByteView encodedCommit,
                                       const std::function<void(const Hash&)>& visit);

}  // namespace usdlive
