// The Python binding of the namespace editor.
#pragma once

#include <nanobind/nanobind.h>

namespace usdlive {

/// Adds the class NamespaceEditor to the module.
void bindNamespace(nanobind::module_& module);

}  // namespace usdlive
