#pragma once

#include <pxr/usd/sdf/path.h>

#include <optional>
#include <string>
#include <vector>

#include "usdlive/client/usd/layers/StageHost.h"

namespace usdlive::layers {

/// A prim or property of the stage by its path as text; nothing for what is malformed or not there.
/// "/" is the whole stage.
[[nodiscard]] std::optional<pxr::SdfPath> specPath(const StageHost& host, const std::string& text);

/// What linking or locking a path is about: a prim and its properties, with `hierarchy` also all
/// below it; a property alone. The pseudo-root itself is never among them.
[[nodiscard]] std::vector<pxr::SdfPath> specsOf(const StageHost& host, const pxr::SdfPath& path,
                                                bool hierarchy);

}  // namespace usdlive::layers
