// Removes edits that later edits overwrite.
#pragma once

#include <vector>

#include "usdlive/common/layer/Edit.h"

namespace usdlive {

/// CF1: returns the edits without those whose register a later edit sets again, so that a session
/// that has fallen behind reads less. Paths are absolute and each edit is valid after the ones
/// before, as in a commit. On any layer on which `edits` apply, the result leads to the same layer.
/// Edits of the namespace are kept, and no edit is dropped in favour of one on the other side of
/// such an edit.
[[nodiscard]] std::vector<Edit> conflated(std::vector<Edit> edits);

}  // namespace usdlive
