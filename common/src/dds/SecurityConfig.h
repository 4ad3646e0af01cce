#pragma once

#include <string>

#include "usdlive/common/core/Result.h"

namespace usdlive::dds {

/// The element Security of a configuration of Cyclone DDS, for a folder with kSecurityFiles.
/// InvalidConfiguration: which of them is missing or wrong, as far as it can be told before they
/// are used.
[[nodiscard]] Result<std::string> securityConfig(const std::string& folder);

}  // namespace usdlive::dds
