// Declares PathMap, moves that happen at once, and MoveSteps, which divides the moves of a batch
// into steps.
#pragma once

#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/path.h>

#include <cstddef>
#include <map>
#include <optional>
#include <unordered_map>
#include <vector>

namespace usdlive::naming {

/// One move of an object. If `to` is empty, the object is deleted.
struct PathMove {
    pxr::SdfPath from, to;
    bool operator==(const PathMove&) const = default;
    [[nodiscard]] bool isReparent() const {
        return !to.IsEmpty() && from.GetParentPath() != to.GetParentPath();
    }
};
using PathMoves = std::vector<PathMove>;

/// Moves that happen at once: all paths `from` are paths before the moves. A query takes as long as
/// the path is deep, however many moves there are.
class PathMap {
public:
    PathMap() = default;
    explicit PathMap(const PathMoves& moves);

    void add(const PathMove& move);
    [[nodiscard]] bool empty() const { return to_.empty(); }
    /// Returns the move of the nearest prefix of `path`, if there is one.
    [[nodiscard]] std::optional<PathMove> nearest(const pxr::SdfPath& path) const;
    /// Returns the path after the moves, or an empty path if it is deleted.
    [[nodiscard]] pxr::SdfPath after(const pxr::SdfPath& path) const;
    /// Returns the path before the moves, or an empty path if no object can be there after them.
    [[nodiscard]] pxr::SdfPath before(const pxr::SdfPath& path) const;
    /// Adds the paths before the moves of objects that are at or below `path` after them.
    void addBefore(const pxr::SdfPath& path, pxr::SdfPathSet& paths) const;

private:
    std::unordered_map<pxr::SdfPath, pxr::SdfPath, pxr::SdfPath::Hash> to_;
    std::map<pxr::SdfPath, pxr::SdfPath> from_;
};

/// Divides moves into steps. The moves of one step do not meet: no path of one is at, above or
/// below a path of another. So they have the same result in any order, and OpenUSD follows them in
/// one change block.
class MoveSteps {
public:
    /// Returns the step of each move of one edit of a batch, for moves in one or more layers. A
    /// move comes after earlier ones that it meets, in whatever layer.
    [[nodiscard]] std::vector<std::vector<std::size_t>> add(
        const std::vector<const PathMoves*>& layers);
    /// Returns the step of moves of one edit that happen at once.
    [[nodiscard]] std::size_t addAtOnce(const std::vector<PathMoves>& moves);
    /// The number of steps so far.
    [[nodiscard]] std::size_t count() const { return count_; }

private:
    // For each path, the first step in which it may be used again.
    using Used = std::map<pxr::SdfPath, std::size_t>;
    static std::size_t firstFree(const Used& used, const pxr::SdfPath& path);
    static std::size_t firstFree(const Used& used, const PathMove& move);
    static void use(Used& used, const PathMove& move, std::size_t step);

    Used used_;
    Used parents_;  // the last step with a move to this new parent: children keep their order
    std::size_t count_ = 0;
};

}  // namespace usdlive::naming
