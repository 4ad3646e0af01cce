// Tests that a population mask lists the paths that it selects.
#include "usdlive/client/usd/stage/PopulationMask.h"

#include <gtest/gtest.h>

namespace usdlive::stage {
namespace {

using pxr::SdfPath;
using Paths = pxr::SdfPathVector;

TEST(PopulationMask, ListsPathsOfWhichNoneIsAboveAnother) {
    const PopulationMask mask({SdfPath("/B"), SdfPath("/A/X"), SdfPath("/B/Y"), SdfPath("/A.p")});
    EXPECT_EQ(mask.paths(), (Paths{SdfPath("/A/X"), SdfPath("/B")}));
    EXPECT_EQ(PopulationMask(mask.paths()), mask);
    EXPECT_TRUE(PopulationMask(Paths{}).paths().empty());
}

TEST(PopulationMask, OfAllPrimsListsTheRoot) {
    EXPECT_EQ(PopulationMask().paths(), Paths{SdfPath::AbsoluteRootPath()});
    EXPECT_TRUE(PopulationMask(PopulationMask().paths()).includesSubtree(SdfPath("/A/B")));
}

}  // namespace
}  // namespace usdlive::stage
