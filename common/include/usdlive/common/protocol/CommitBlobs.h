#pragma once

// Which big values (V9) an encoded commit names.

#include <functional>

#include "usdlive/common/core/Bytes.h"
#include "usdlive/common/core/Hash.h"
#include "usdlive/common/core/Result.h"

namespace usdlive {

/// Calls `visit` for every blob that an encoded commit names, in what it dropped, too. Holds one
/// value of it at a time. MalformedFrame, InvalidValue.
[[nodiscard]] Result<void> forEachBlob(ByteView encodedCommit,
                                       const std::function<void(const Hash&)>& visit);

}  // namespace usdlive
