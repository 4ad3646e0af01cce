// Tests MoveSteps and PathMap: moves in steps have the same result as one after the other.
#include "usd/namespace/MoveSteps.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <set>
#include <string>
#include <vector>

using namespace usdlive::naming;
using pxr::SdfPath;

namespace {

PathMove move(const std::string& from, const std::string& to) {
    return {SdfPath(from), to.empty() ? SdfPath() : SdfPath(to)};
}

std::vector<PathMoves> inSteps(const PathMoves& moves) {
    MoveSteps steps;
    std::vector<PathMoves> result;
    for (const auto& one : moves) {
        const PathMoves alone{one};
        const auto step = steps.add({&alone}).front().front();
        result.resize(steps.count());
        result[step].push_back(one);
    }
    return result;
}

bool meet(const PathMove& one, const PathMove& other) {
    for (const SdfPath& a : {one.from, one.to})
        for (const SdfPath& b : {other.from, other.to})
            if (!a.IsEmpty() && !b.IsEmpty() && (a.HasPrefix(b) || b.HasPrefix(a))) return true;
    return false;
}

// Makes random moves of prims that exist, to paths that are free.
class RandomMoves {
public:
    explicit RandomMoves(unsigned seed) : random_(seed) {
        for (const char a : {'a', 'b', 'c'})
            for (const char b : {'x', 'y'}) {
                prims_.insert(SdfPath(std::string("/") + a));
                prims_.insert(SdfPath(std::string("/") + a + "/" + b));
            }
    }

    PathMoves make(int count) {
        PathMoves moves;
        for (int i = 0; i < count && !prims_.empty(); ++i) moves.push_back(next());
        return moves;
    }

private:
    PathMove next() {
        const SdfPath from = pick();
        SdfPath to;
        for (int tries = 0; tries < 20 && to.IsEmpty() && random_() % 8; ++tries) {
            const SdfPath parent = random_() % 2 ? SdfPath::AbsoluteRootPath() : pick();
            const SdfPath path =
                parent.AppendChild(pxr::TfToken(std::string(1, char('a' + random_() % 5))));
            if (!parent.HasPrefix(from) && !prims_.contains(path)) to = path;
        }
        std::set<SdfPath> now;
        for (const SdfPath& prim : prims_)
            if (!prim.HasPrefix(from))
                now.insert(prim);
            else if (!to.IsEmpty())
                now.insert(prim.ReplacePrefix(from, to));
        prims_ = now;
        return {from, to};
    }
    SdfPath pick() { return *std::next(prims_.begin(), std::ptrdiff_t(random_() % prims_.size())); }

    std::mt19937 random_;
    std::set<SdfPath> prims_;
};

SdfPath afterAll(const PathMoves& moves, SdfPath path) {
    for (const auto& one : moves)
        if (!path.IsEmpty() && path.HasPrefix(one.from))
            path = one.to.IsEmpty() ? SdfPath() : path.ReplacePrefix(one.from, one.to);
    return path;
}

}  // namespace

TEST(MoveSteps, AnyMovesHaveTheSameResultInSteps) {
    for (unsigned seed = 0; seed < 3000; ++seed) {
        SCOPED_TRACE(seed);
        const auto moves = RandomMoves(seed).make(6);
        const auto steps = inSteps(moves);
        for (const char* path : {"/a", "/b", "/c", "/a/x", "/a/y", "/b/x", "/c/y", "/c/y.p"}) {
            SdfPath now(path);
            for (const auto& step : steps) {
                const PathMap map(step);
                const SdfPath next = now.IsEmpty() ? now : map.after(now);
                if (!next.IsEmpty()) {
                    EXPECT_EQ(map.before(next), now);
                }
                now = next;
            }
            EXPECT_EQ(now, afterAll(moves, SdfPath(path))) << path;
        }
        for (const auto& step : steps)
            for (std::size_t i = 0; i < step.size(); ++i)
                for (std::size_t j = 0; j < i; ++j) EXPECT_FALSE(meet(step[i], step[j]));
    }
}

TEST(MoveSteps, MovesThatDoNotMeetShareAStep) {
    EXPECT_EQ(inSteps({move("/a", "/d"), move("/b", ""), move("/c/x", "/e/x")}).size(), 1U);
    EXPECT_EQ(
        inSteps({move("/a", "/d"), move("/b", "/a"), move("/c", "/e"), move("/f", "/c")}).size(),
        2U);
    EXPECT_EQ(inSteps({move("/a", "/d"), move("/d/x", "/d/y")}).size(), 2U);
}

TEST(MoveSteps, ChildrenOfANewParentKeepTheirOrder) {
    const auto steps =
        inSteps({move("/a", "/d"), move("/b", "/a"), move("/a", "/G/a"), move("/c", "/G/c")});
    ASSERT_EQ(steps.size(), 3U);
    EXPECT_EQ(steps[2], (PathMoves{move("/a", "/G/a"), move("/c", "/G/c")}));
}

TEST(MoveSteps, MovesOfOneEditInSeveralLayersShareAStep) {
    const PathMoves one{move("/a", "/d")}, next{move("/b", "/a")}, none;
    MoveSteps steps;
    EXPECT_EQ(steps.add({&one, &one}), (std::vector<std::vector<std::size_t>>{{0}, {0}}));
    EXPECT_EQ(steps.add({&none, &next}), (std::vector<std::vector<std::size_t>>{{}, {1}}));
}

TEST(PathMap, TheNearestMoveCounts) {
    const PathMap moves(PathMoves{move("/A", "/B"), move("/A/P", "/Q"), move("/A/D", "")});
    EXPECT_EQ(moves.after(SdfPath("/A/x.y")), SdfPath("/B/x.y"));
    EXPECT_EQ(moves.after(SdfPath("/A/P/x")), SdfPath("/Q/x"));
    EXPECT_EQ(moves.after(SdfPath("/A/D/x")), SdfPath());
    EXPECT_EQ(moves.after(SdfPath("../x")), SdfPath("../x"));
    EXPECT_EQ(moves.before(SdfPath("/B/x")), SdfPath("/A/x"));
    EXPECT_EQ(moves.before(SdfPath("/A/x")), SdfPath());
    pxr::SdfPathSet paths;
    moves.addBefore(SdfPath::AbsoluteRootPath(), paths);
    EXPECT_EQ(paths,
              (pxr::SdfPathSet{SdfPath::AbsoluteRootPath(), SdfPath("/A"), SdfPath("/A/P")}));
}
