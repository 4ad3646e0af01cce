#pragma once

#include <vector>

#include "usdlive/common/layer/Edit.h"

namespace usdlive {

/// The edits without those whose register a later one sets again, so that somebody who fell behind
/// has less to read (CF1). Paths are absolute and each edit valid after the ones before, as in a
/// commit; both rows of edits lead from any layer on which the whole applies to the same layer.
/// What changes the namespace stays, and no edit is dropped for one on the other side of it.
[[nodiscard]] std::vector<Edit> conflated(std::vector<Edit> edits);

}  // namespace usdlive
