// Moments as people write them.
#pragma once

#include <cstdint>
#include <string_view>

#include "usdlive/common/core/Result.h"

namespace usdlive::client {

/// Returns the moment in milliseconds since 1970. `text` is a time before now (`90s`, `30m`, `2h`,
/// `3d`, `2w`), or a local date with or without time (`2026-11-29`, `2026-11-29 14:05`,
/// `2026-11-29T14:05:30`). Error: InvalidArgument.
[[nodiscard]] Result<std::int64_t> momentOf(std::string_view text);

}  // namespace usdlive::client
