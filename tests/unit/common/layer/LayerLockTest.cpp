// Tests the lock of a layer in its own data (LK1).
#include "usdlive/common/layer/LayerLock.h"

#include <gtest/gtest.h>

#include "MustApply.h"

namespace usdlive {
namespace {

TEST(LayerLock, ReadsBackTheWrittenLock) {
    LayerDoc doc;
    EXPECT_EQ(lockOf(doc), LayerLock());
    const LayerLock lock{true, {"ada"}, 1'700'000'000'500};
    mustApply(doc, lockEdits(lock));
    EXPECT_EQ(lockOf(doc), lock);
    mustApply(doc, lockEdits({}));
    EXPECT_EQ(lockOf(doc), LayerLock());
}

// Kit's form: customLayerData = { dictionary omni_layer = { bool locked = 1 } }
TEST(LayerLock, KitsLockHasNoHolder) {
    LayerDoc doc;
    mustApply(doc, {SetField{"customLayerData", DictionaryKey{{"omni_layer", "locked"}},
                             boolValue(true)}});
    EXPECT_EQ(lockOf(doc), (LayerLock{true, {}, 0}));
    mustApply(doc, {SetField{"customLayerData", DictionaryKey{{"omni_layer", "locked_by"}},
                             doubleValue(7)}});
    EXPECT_EQ(lockOf(doc), (LayerLock{true, {}, 0}));
}

TEST(LayerLock, ALayerWithKitsMapOfLocksHasNoneItself) {
    LayerDoc doc;
    EXPECT_TRUE(checkLockable(LayerId{"a.usda"}, doc));
    mustApply(doc, lockEdits({true, {"ada"}, 1}));
    EXPECT_TRUE(checkLockable(LayerId{"a.usda"}, doc));
    mustApply(doc, {EraseField{"customLayerData", {}},
                    SetField{"customLayerData", DictionaryKey{{"omni_layer", "locked", "./b.usda"}},
                             boolValue(true)}});
    const auto refused = checkLockable(LayerId{"a.usda"}, doc);
    ASSERT_FALSE(refused);
    EXPECT_EQ(refused.error().code, ErrorCode::InvalidArgument);
}

TEST(LayerLock, RecognizesItsOwnFields) {
    for (const EditAction& action : lockEdits({true, {"ada"}, 1})) {
        EXPECT_TRUE(isLockEdit(action));
        EXPECT_TRUE(touchesLock(action));
    }
    const auto key = [](std::vector<std::string> path) {
        return EditAction(
            SetField{"customLayerData", DictionaryKey{std::move(path)}, boolValue(true)});
    };
    EXPECT_FALSE(isLockEdit(key({"omni_layer"})));
    EXPECT_TRUE(touchesLock(key({"omni_layer"})));
    EXPECT_FALSE(touchesLock(key({"omni_layer", "muteness"})));
    EXPECT_FALSE(touchesLock(key({"mine", "locked"})));
    EXPECT_TRUE(touchesLock(EraseField{"customLayerData", {}}));
    EXPECT_FALSE(isLockEdit(EraseField{"customLayerData", {}}));
    EXPECT_FALSE(touchesLock(EraseField{"comment", {}}));
}

}  // namespace
}  // namespace usdlive
