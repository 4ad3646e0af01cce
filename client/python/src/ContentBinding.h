#pragma once

#include <nanobind/nanobind.h>

namespace usdlive {

/// Edits of layers and their undo, as the submodule `content`. Layers go by their identifiers.
void bindContent(nanobind::module_& module);

}  // namespace usdlive
