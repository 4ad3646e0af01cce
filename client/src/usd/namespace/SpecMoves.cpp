// Moves specs within one layer in as few batches as possible.
#include "SpecMoves.h"

#include <pxr/usd/sdf/cleanupEnabler.h>
#include <pxr/usd/sdf/namespaceEdit.h>
#include <pxr/usd/sdf/primSpec.h>

#include <algorithm>
#include <array>
#include <optional>
#include <ranges>
#include <utility>

namespace usdlive::naming {

using pxr::SdfLayerHandle;
using pxr::SdfPath;

namespace {

bool isReparent(const PathMove& move) {
    return !move.to.IsEmpty() && move.from.GetParentPath() != move.to.GetParentPath();
}

// Returns the parents that the layer lacks, by their paths before all moves, so that one batch can
// make the moves. Returns nothing if an object that moves away later occupies the path of a parent.
std::optional<std::vector<SdfPath>> missingParents(const SdfLayerHandle& layer,
                                                   const PathMoves& moves) {
    std::vector<SdfPath> missing;
    PathMoves made;
    for (const auto& move : moves) {
        if (isReparent(move)) {
            const SdfPath parent = pathBefore(made, move.to.GetParentPath());
            if (parent.IsEmpty()) return std::nullopt;
            if (!layer->HasSpec(parent)) missing.push_back(parent);
        }
        made.push_back(move);
    }
    return missing;
}

// Keeps the place among the siblings if only the name changes.
pxr::SdfBatchNamespaceEdit batchOf(const PathMoves& moves) {
    pxr::SdfBatchNamespaceEdit batch;
    for (const auto& [from, to] : moves) batch.Add(from, to, pxr::SdfNamespaceEdit::Same);
    return batch;
}

bool applyAll(const SdfLayerHandle& layer, const PathMoves& moves) {
    return moves.empty() || layer->Apply(batchOf(moves));
}

bool applyOneByOne(const SdfLayerHandle& layer, const PathMoves& moves) {
    return std::ranges::all_of(moves, [&](const PathMove& move) {
        if (isReparent(move) && !pxr::SdfJustCreatePrimInLayer(layer, move.to.GetParentPath()))
            return false;
        return applyAll(layer, {move});
    });
}

bool moveAndCleanUp(const SdfLayerHandle& layer, const PathMoves& moves, EmptiedOvers emptied) {
    if (moves.empty()) return true;
    std::optional<pxr::SdfCleanupEnabler> cleanup;
    if (emptied == EmptiedOvers::Remove && std::ranges::any_of(moves, isReparent))
        cleanup.emplace();
    const auto missing = missingParents(layer, moves);
    if (!missing) return applyOneByOne(layer, moves);
    for (const SdfPath& parent : *missing)
        if (!pxr::SdfJustCreatePrimInLayer(layer, parent)) return false;
    return applyAll(layer, moves);
}

// Splits the moves into deletes at the original paths and other moves. A delete alone would leave
// empty overs. Returns nothing if other moves lead through a deleted object.
std::optional<std::pair<PathMoves, PathMoves>> splitDeletes(const SdfLayerHandle& layer,
                                                            const PathMoves& moves) {
    PathMoves others, deletes;
    const auto leadsThrough = [&](const PathMove& other, const PathMove& gone) {
        return std::ranges::any_of(std::array{other.from, other.to}, [&](const SdfPath& path) {
            return path.HasPrefix(gone.from) || (!gone.to.IsEmpty() && path.HasPrefix(gone.to));
        });
    };
    for (std::size_t i = 0; i < moves.size(); ++i) {
        if (!isDeletedBy(moves, i)) {
            others.push_back(moves[i]);
            continue;
        }
        // A later move may reuse the path of an object that is deleted here.
        const std::size_t end = moves[i].to.IsEmpty() ? i : moves.size();
        for (std::size_t other = 0; other < end; ++other)
            if (!isDeletedBy(moves, other) && leadsThrough(moves[other], moves[i]))
                return std::nullopt;
        const SdfPath origin =
            pathBefore({moves.begin(), moves.begin() + std::ptrdiff_t(i)}, moves[i].from);
        const bool isKnown = std::ranges::any_of(
            deletes, [&](const PathMove& one) { return origin.HasPrefix(one.from); });
        if (origin.IsEmpty()) return std::nullopt;
        // Skips an object that the layer lacks: an over that a move would have created.
        if (!isKnown && layer->HasSpec(origin)) deletes.push_back({origin, {}});
    }
    return std::pair(deletes, others);
}

}  // namespace

SdfPath pathBefore(const PathMoves& moves, SdfPath path) {
    for (const auto& [from, to] : std::views::reverse(moves)) {
        if (!to.IsEmpty() && path.HasPrefix(to))
            path = path.ReplacePrefix(to, from);
        else if (path.HasPrefix(from))
            return {};
    }
    return path;
}

bool canMoveSpecs(const SdfLayerHandle& layer, const PathMoves& moves) {
    const auto missing = missingParents(layer, moves);
    return missing && missing->empty() &&
           layer->CanApply(batchOf(moves)) != pxr::SdfNamespaceEditDetail::Error;
}

bool isDeletedBy(const PathMoves& moves, std::size_t i) {
    const PathMoves later(moves.begin() + std::ptrdiff_t(i) + 1, moves.end());
    return moves[i].to.IsEmpty() || followed(later, moves[i].to).IsEmpty();
}

bool moveSpecs(const SdfLayerHandle& layer, const PathMoves& moves, EmptiedOvers emptied) {
    if (const auto split = splitDeletes(layer, moves))
        return applyAll(layer, split->first) && moveAndCleanUp(layer, split->second, emptied);
    return moveAndCleanUp(layer, moves, emptied);
}

}  // namespace usdlive::naming
