// Declares functions that move specs within one layer.
#pragma once

#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/path.h>

#include <vector>

#include "PathValues.h"

namespace usdlive::naming {

/// The overs that become empty by moves out of them.
enum class EmptiedOvers { Remove, Keep };

/// Makes the moves in their order, with as few operations as possible. Creates missing parents as
/// overs. Returns false if Sdf refuses a move; the layer may then be partly changed.
[[nodiscard]] bool moveSpecs(const pxr::SdfLayerHandle& layer, const PathMoves& moves,
                             EmptiedOvers emptied = EmptiedOvers::Remove);

/// Returns true if Sdf would make these moves. Returns false if a parent is missing.
[[nodiscard]] bool canMoveSpecs(const pxr::SdfLayerHandle& layer, const PathMoves& moves);

/// Returns the path before `moves` of the object at `path` after them, or an empty path if no
/// object can be there.
[[nodiscard]] pxr::SdfPath pathBefore(const PathMoves& moves, pxr::SdfPath path);

/// Returns true if the object that `moves[i]` moves is deleted by this move or by a later one.
[[nodiscard]] bool isDeletedBy(const PathMoves& moves, std::size_t i);

}  // namespace usdlive::naming
