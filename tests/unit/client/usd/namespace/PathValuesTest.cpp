// Tests how paths in field values follow the moves of one edit.
#include "usd/namespace/PathValues.h"

#include <gtest/gtest.h>
#include <pxr/base/vt/array.h>
#include <pxr/usd/sdf/listOp.h>
#include <pxr/usd/sdf/pathExpression.h>
#include <pxr/usd/sdf/payload.h>
#include <pxr/usd/sdf/reference.h>

using namespace usdlive::naming;
using pxr::SdfPath;
using pxr::SdfPathExpression;
using pxr::SdfPathListOp;
using pxr::VtValue;

namespace {

// "/A" moves below "/B", which ends. "/C" and "/D" change places.
const PathMap kMoves(PathMoves{{SdfPath("/A"), SdfPath("/B/X")},
                               {SdfPath("/B"), SdfPath()},
                               {SdfPath("/C"), SdfPath("/D")},
                               {SdfPath("/D"), SdfPath("/C")}});

}  // namespace

TEST(PathValues, MovesOfOneEditHappenAtOnce) {
    const auto list = SdfPathListOp::CreateExplicit(
        {SdfPath("/A/P.x"), SdfPath("/B/Y"), SdfPath("/C/P"), SdfPath("/D"), SdfPath("/E")});
    EXPECT_EQ(movedValue(VtValue(list), kMoves),
              SdfPathListOp::CreateExplicit(
                  {SdfPath("/B/X/P.x"), SdfPath("/D/P"), SdfPath("/C"), SdfPath("/E")}));
    EXPECT_EQ(movedValue(VtValue(SdfPathExpression("/A//* + /B/Y + /C + /D/P//* - /E")), kMoves),
              SdfPathExpression("/B/X//* + /D + /C/P//* - /E"));
    EXPECT_EQ(movedValue(VtValue(pxr::VtArray<SdfPath>{SdfPath("/C"), SdfPath("/D")}), kMoves),
              (pxr::VtArray<SdfPath>{SdfPath("/D"), SdfPath("/C")}));
}

TEST(PathValues, TheMoveOfTheNearestPrefixCounts) {
    const PathMap moves(
        PathMoves{{SdfPath("/A"), SdfPath("/B")}, {SdfPath("/A/P"), SdfPath("/Q")}});
    EXPECT_EQ(movedValue(VtValue(SdfPath("/A/P/R")), moves), SdfPath("/Q/R"));
    EXPECT_EQ(movedValue(VtValue(SdfPathExpression("/A/P/R + /A/R")), moves),
              SdfPathExpression("/Q/R + /B/R"));
}

TEST(PathValues, AValueWithoutMovedPathsIsEmpty) {
    EXPECT_TRUE(
        movedValue(VtValue(SdfPathListOp::CreateExplicit({SdfPath("/E")})), kMoves).IsEmpty());
    EXPECT_TRUE(movedValue(VtValue(SdfPathExpression("/E//*")), kMoves).IsEmpty());
    EXPECT_TRUE(movedValue(VtValue(1.0), kMoves).IsEmpty());
}

TEST(PathValues, InternalArcsFollowAndArcsToOtherFilesStay) {
    const auto references = pxr::SdfReferenceListOp::CreateExplicit(
        {{"", SdfPath("/C")}, {"other.usda", SdfPath("/C")}, {"", SdfPath("/B")}, {}});
    EXPECT_EQ(movedArcs(VtValue(references), kMoves, SdfPath("/User")),
              pxr::SdfReferenceListOp::CreateExplicit(
                  {{"", SdfPath("/D")}, {"other.usda", SdfPath("/C")}, {}}));
    EXPECT_EQ(movedArcs(VtValue(pxr::SdfPayloadListOp::Create({{"", SdfPath("/A/P")}})), kMoves,
                        SdfPath("/User")),
              pxr::SdfPayloadListOp::Create({{"", SdfPath("/B/X/P")}}));
    pxr::SdfPathSet paths;
    EXPECT_TRUE(collectPaths(VtValue(references), paths));
    EXPECT_EQ(paths, (pxr::SdfPathSet{SdfPath("/B"), SdfPath("/C")}));
}

TEST(PathValues, AnArcThatWouldLeadAboveOrBelowItsOwnerIsRemoved) {
    const VtValue inherits(SdfPathListOp::Create({SdfPath("/A"), SdfPath("/E")}));
    const VtValue left(SdfPathListOp::Create({SdfPath("/E")}));
    EXPECT_EQ(movedArcs(inherits, kMoves, SdfPath("/B/X/User")), left);
    EXPECT_EQ(movedArcs(inherits, kMoves, SdfPath("/B")), left);
    EXPECT_TRUE(movedArcs(left, kMoves, SdfPath("/E/User")).IsEmpty());
}
