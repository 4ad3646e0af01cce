// The Python binding of the layers API.
#pragma once

#include <nanobind/nanobind.h>

#include "usdlive/client/usd/Client.h"

namespace usdlive {

/// Returns the connection of a Python client, or nullptr if it was closed.
[[nodiscard]] Client* clientOf(nanobind::handle client);

/// Adds `usdlive::layers` to the package: layers are named by their identifiers, spec paths are
/// text.
void bindLayers(nanobind::module_& module);

}  // namespace usdlive
