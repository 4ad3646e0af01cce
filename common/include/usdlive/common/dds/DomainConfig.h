// The configuration of Cyclone DDS.
#pragma once

#include <string>

#include "usdlive/common/dds/Domain.h"

namespace usdlive::dds {

/// Returns the configuration of Cyclone DDS for the settings, as createDomain() uses it.
[[nodiscard]] Result<std::string> cycloneConfig(const DomainSettings& settings);

}  // namespace usdlive::dds
