#pragma once

#include <string>

#include "usdlive/common/dds/Domain.h"

namespace usdlive::dds {

/// The configuration of Cyclone DDS that the settings mean, as createDomain() uses it.
[[nodiscard]] Result<std::string> cycloneConfig(const DomainSettings& settings);

}  // namespace usdlive::dds
