// How large a transaction is, before it is encoded.
#pragma once

#include <cstdint>

#include "usdlive/common/layer/Edit.h"

namespace usdlive::client {

/// The bytes of names and values in a transaction: its encoded frame is larger. Costs no copy, so
/// that a transaction too large for a frame is found without building one (a FlatBuffer beyond
/// 2 GiB cannot be built at all).
[[nodiscard]] std::uint64_t leastFrameBytes(const Transaction& transaction);

}  // namespace usdlive::client
