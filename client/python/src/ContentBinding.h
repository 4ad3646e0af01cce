// The Python binding of edits of layers and their undo.
#pragma once

#include <nanobind/nanobind.h>

namespace usdlive {

/// Adds the submodule `content`: edits of layers and their undo. Layers are named by their
/// identifiers.
void bindContent(nanobind::module_& module);

}  // namespace usdlive
