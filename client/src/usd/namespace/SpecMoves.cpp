// Moves specs within one layer in as few batches as possible.
#include "SpecMoves.h"

#include <pxr/usd/sdf/cleanupEnabler.h>
#include <pxr/usd/sdf/namespaceEdit.h>
#include <pxr/usd/sdf/primSpec.h>

#include <algorithm>
#include <optional>

namespace usdlive::naming {

using pxr::SdfLayerHandle;

namespace {

// Keeps the place among the siblings if only the name changes.
bool applyAll(const SdfLayerHandle& layer, const PathMoves& moves) {
    if (moves.empty()) return true;
    pxr::SdfBatchNamespaceEdit batch;
    for (const auto& [from, to] : moves) batch.Add(from, to, pxr::SdfNamespaceEdit::Same);
    return layer->Apply(batch);
}

}  // namespace

bool moveSpecs(const SdfLayerHandle& layer, const PathMoves& moves, EmptiedOvers emptied) {
    PathMoves deletes, others;
    for (const auto& move : moves) (move.to.IsEmpty() ? deletes : others).push_back(move);
    // A delete alone leaves empty overs.
    if (!applyAll(layer, deletes)) return false;
    std::optional<pxr::SdfCleanupEnabler> cleanup;
    if (emptied == EmptiedOvers::Remove && std::ranges::any_of(others, &PathMove::isReparent))
        cleanup.emplace();
    for (const auto& move : others)
        if (move.isReparent() && !pxr::SdfJustCreatePrimInLayer(layer, move.to.GetParentPath()))
            return false;
    return applyAll(layer, others);
}

}  // namespace usdlive::naming
