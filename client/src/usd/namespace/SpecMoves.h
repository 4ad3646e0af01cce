// Declares moveSpecs(), which moves specs within one layer.
#pragma once

#include <pxr/usd/sdf/layer.h>

#include "usd/namespace/MoveSteps.h"

namespace usdlive::naming {

/// The overs that become empty by moves out of them.
enum class EmptiedOvers { Remove, Keep };

/// Makes the moves of one step (MoveSteps) in linear time. Creates missing parents as overs.
/// Returns false if the layer refuses a move; it may then be partly changed.
[[nodiscard]] bool moveSpecs(const pxr::SdfLayerHandle& layer, const PathMoves& moves,
                             EmptiedOvers emptied = EmptiedOvers::Remove);

}  // namespace usdlive::naming
