#pragma once

#include <nanobind/nanobind.h>

#include "usdlive/client/usd/Client.h"

namespace usdlive {

/// The connection behind a Python client; nullptr when it was closed.
[[nodiscard]] Client* clientOf(nanobind::handle client);

/// `usdlive::layers` for the package: layers by their identifiers, spec paths as text.
void bindLayers(nanobind::module_& module);

}  // namespace usdlive
