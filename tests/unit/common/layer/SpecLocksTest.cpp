// Tests locks of specs in a root layer (LK5).
#include "usdlive/common/layer/SpecLocks.h"

#include <gtest/gtest.h>

#include "unit/common/layer/SpecLockEdits.h"

namespace usdlive {
namespace {

TEST(SpecLocks, LK5ReadsBackTheWrittenLocks) {
    LayerDoc doc;
    EXPECT_TRUE(specLocksOf(doc).empty());
    for (const EditAction& action :
         {specLockEdit("/A", {"ada"}), specLockEdit("/A.xformOp:translate", {"bo"}),
          specLockEdit("/B", {})}) {
        EXPECT_TRUE(touchesSpecLocks(action));
        ASSERT_TRUE(doc.apply("/", action));
    }
    EXPECT_EQ(specLocksOf(doc),
              (SpecLocks{{"/A", {"ada"}}, {"/A.xformOp:translate", {"bo"}}, {"/B", {}}}));
    ASSERT_TRUE(doc.apply("/", specUnlockEdit("/A")));
    EXPECT_EQ(specLocksOf(doc).size(), 2u);
    EXPECT_TRUE(touchesSpecLocks(EraseField{"customLayerData", {}}));
    EXPECT_FALSE(touchesSpecLocks(EraseField{"comment", {}}));
    EXPECT_FALSE(touchesSpecLocks(
        SetField{"customLayerData", DictionaryKey{{"omni_layer", "locked"}}, boolValue(true), {}}));
}

TEST(SpecLocks, AVariantIsNotPartOfTheStagesPath) {
    EXPECT_EQ(withoutVariants("/A/B.x"), "/A/B.x");
    EXPECT_EQ(withoutVariants("/A{set=one}B.x"), "/A/B.x");
    EXPECT_EQ(withoutVariants("/A{set=one}.x"), "/A.x");
    EXPECT_EQ(withoutVariants("/A{set=one}{in=two}B{t=}"), "/A/B");
    EXPECT_EQ(withoutVariants("/"), "/");
}

}  // namespace
}  // namespace usdlive
