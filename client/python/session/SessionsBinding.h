// The live sessions of a project.
#pragma once

#include <nanobind/nanobind.h>

namespace usdlive {

/// Adds the class Sessions.
void bindSessions(nanobind::module_& module);

}  // namespace usdlive
