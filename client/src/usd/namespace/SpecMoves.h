// Moves of specs within one layer.
#pragma once

#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/path.h>

#include <vector>

#include "PathValues.h"

namespace usdlive::naming {

/// Makes the moves in their order, as few as lead to the same. Parents that the layer lacks are
/// made as overs, and overs that nothing is left in are removed. False: Sdf refused one; the layer
/// may be changed in part.
[[nodiscard]] bool moveSpecs(const pxr::SdfLayerHandle& layer, const PathMoves& moves);

/// Would Sdf make these moves? Parents that are missing are made first.
[[nodiscard]] bool canMoveSpecs(const pxr::SdfLayerHandle& layer, const PathMoves& moves);

/// The path before `moves` of what is at `path` after them; empty: nothing can be there.
[[nodiscard]] pxr::SdfPath pathBefore(const PathMoves& moves, pxr::SdfPath path);

/// Is what `moves[i]` moves deleted, by it or by a later one?
[[nodiscard]] bool isDeletedBy(const PathMoves& moves, std::size_t i);

}  // namespace usdlive::naming
