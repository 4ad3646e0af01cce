// Tests the table of locks of specs: when locks take effect, and which specs they cover.
#include "usd/layers/SpecLockTable.h"

#include <gtest/gtest.h>

namespace usdlive::layers {

using pxr::SdfPath;
using Specs = std::vector<SdfPath>;

const UserName kLockOwner{"ada"};

TEST(SpecLockTable, ALockIsPendingUntilItIsAdmitted) {
    SpecLockTable table;
    EXPECT_FALSE(table.admit());
    EXPECT_EQ(table.assign({{SdfPath("/A"), kLockOwner}}), Specs{SdfPath("/A")});
    EXPECT_TRUE(table.isLocked(SdfPath("/A")));
    EXPECT_FALSE(table.holds(SdfPath("/A"))) << "earlier edits stay";
    EXPECT_TRUE(table.admit());
    EXPECT_TRUE(table.holds(SdfPath("/A")));
    EXPECT_TRUE(table.assign(table.all()).empty()) << "nothing has changed";
    EXPECT_EQ(table.assign({}), Specs{SdfPath("/A")});
    EXPECT_FALSE(table.holds(SdfPath("/A"))) << "an unlocked spec is free at once";
}

TEST(SpecLockTable, ALockCoversWhatIsBelow) {
    SpecLockTable table;
    table.assign({{SdfPath("/A/B"), kLockOwner}, {SdfPath("/A/B.x"), kLockOwner}});
    table.admit();
    EXPECT_TRUE(table.covers(SdfPath("/A/B/C.y")));
    EXPECT_FALSE(table.covers(SdfPath("/A")));
    EXPECT_TRUE(table.hasLockBelow(SdfPath("/A")));
    EXPECT_FALSE(table.hasLockBelow(SdfPath("/A/B/C")));
    EXPECT_EQ(table.below(SdfPath("/A")), (Specs{SdfPath("/A/B"), SdfPath("/A/B.x")}));
    EXPECT_TRUE(table.below(SdfPath("/Other")).empty());
}

TEST(SpecLockTable, APropertyThatIsUnlockedBelowALockedPrimIsReleased) {
    SpecLockTable table;
    const SpecLockTable::Locks both{{SdfPath("/A"), kLockOwner}, {SdfPath("/A.x"), kLockOwner}};
    table.assign(both);
    table.admit();
    table.assign({{SdfPath("/A"), kLockOwner}});
    EXPECT_TRUE(table.isReleased(SdfPath("/A.x")));
    table.assign(both);
    EXPECT_FALSE(table.isReleased(SdfPath("/A.x"))) << "it is locked again";
}

}  // namespace usdlive::layers
