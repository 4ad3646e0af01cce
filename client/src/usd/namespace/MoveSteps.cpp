// Divides moves into steps of moves that do not meet.
#include "usd/namespace/MoveSteps.h"

#include <algorithm>

namespace usdlive::naming {

using pxr::SdfPath;

PathMap::PathMap(const PathMoves& moves) {
    for (const auto& move : moves) add(move);
}

void PathMap::add(const PathMove& move) {
    to_[move.from] = move.to;
    if (!move.to.IsEmpty()) from_[move.to] = move.from;
}

std::optional<PathMove> PathMap::nearest(const SdfPath& path) const {
    if (to_.empty() || !path.IsAbsolutePath()) return std::nullopt;
    for (SdfPath at = path; !at.IsEmpty(); at = at.GetParentPath())
        if (const auto move = to_.find(at); move != to_.end()) return PathMove{at, move->second};
    return std::nullopt;
}

SdfPath PathMap::after(const SdfPath& path) const {
    const auto move = nearest(path);
    if (!move) return path;
    return move->to.IsEmpty() ? SdfPath() : path.ReplacePrefix(move->from, move->to);
}

SdfPath PathMap::before(const SdfPath& path) const {
    for (SdfPath at = path; !at.IsEmpty(); at = at.GetParentPath()) {
        if (const auto move = from_.find(at); move != from_.end())
            return path.ReplacePrefix(at, move->second);
        if (to_.contains(at)) return {};
    }
    return path;
}

void PathMap::addBefore(const SdfPath& path, pxr::SdfPathSet& paths) const {
    if (const SdfPath same = before(path); !same.IsEmpty()) paths.insert(same);
    for (auto move = from_.upper_bound(path); move != from_.end() && move->first.HasPrefix(path);
         ++move)
        paths.insert(move->second);
}

std::size_t MoveSteps::firstFree(const Used& used, const SdfPath& path) {
    std::size_t step = 0;
    for (SdfPath at = path; !at.IsEmpty(); at = at.GetParentPath())
        if (const auto found = used.find(at); found != used.end())
            step = std::max(step, found->second);
    for (auto below = used.upper_bound(path); below != used.end() && below->first.HasPrefix(path);
         ++below)
        step = std::max(step, below->second);
    return step;
}

std::size_t MoveSteps::firstFree(const Used& used, const PathMove& move) {
    const std::size_t from = firstFree(used, move.from);
    return move.to.IsEmpty() ? from : std::max(from, firstFree(used, move.to));
}

void MoveSteps::use(Used& used, const PathMove& move, std::size_t step) {
    for (const SdfPath& path : {move.from, move.to})
        if (!path.IsEmpty()) {
            auto& free = used[path];
            free = std::max(free, step + 1);
        }
}

std::vector<std::vector<std::size_t>> MoveSteps::add(const std::vector<const PathMoves*>& layers) {
    std::vector<std::vector<std::size_t>> steps;
    for (const auto* moves : layers) {
        auto& ofLayer = steps.emplace_back();
        Used before;  // by earlier moves of this edit in this layer
        for (const auto& move : *moves) {
            std::size_t step = std::max(firstFree(used_, move), firstFree(before, move));
            if (const auto parent = parents_.find(move.to.GetParentPath());
                move.isReparent() && parent != parents_.end())
                step = std::max(step, parent->second);
            use(before, move, step);
            ofLayer.push_back(step);
            count_ = std::max(count_, step + 1);
        }
    }
    for (std::size_t layer = 0; layer < layers.size(); ++layer)
        for (std::size_t i = 0; i < layers[layer]->size(); ++i) {
            const auto& move = (*layers[layer])[i];
            use(used_, move, steps[layer][i]);
            if (!move.isReparent()) continue;
            auto& last = parents_[move.to.GetParentPath()];
            last = std::max(last, steps[layer][i]);
        }
    return steps;
}

std::size_t MoveSteps::addAtOnce(const std::vector<PathMoves>& moves) {
    std::size_t step = 0;
    for (const auto& some : moves)
        for (const auto& move : some) step = std::max(step, firstFree(used_, move));
    for (const auto& some : moves)
        for (const auto& move : some) use(used_, move, step);
    count_ = std::max(count_, step + 1);
    return step;
}

}  // namespace usdlive::naming
