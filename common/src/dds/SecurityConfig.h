// The DDS Security part of a Cyclone DDS configuration.
#pragma once

#include <string>

#include "usdlive/common/core/Result.h"

namespace usdlive::dds {

/// Returns the Security element of a Cyclone DDS configuration, for a folder with kSecurityFiles.
/// Error: InvalidConfiguration names the file that is missing or wrong, as far as it can be checked
/// before use.
[[nodiscard]] Result<std::string> securityConfig(const std::string& folder);

}  // namespace usdlive::dds
