// Tests global mutes in a root layer (MU1).
#include "usdlive/common/layer/GlobalMuteness.h"

#include <gtest/gtest.h>

#include "MustApply.h"

namespace usdlive {
namespace {

using Layers = std::set<LayerId>;
const LayerId kRoot{"shots/one/root.usda"}, kAnim{"shots/one/anim.usda"}, kSet{"sets/set.usd"};

EditAction entry(const std::string& key, FieldValue value) {
    return SetField{"customLayerData", DictionaryKey{{"omni_layer", "muteness", key}},
                    std::move(value)};
}

TEST(GlobalMuteness, MU1ReadsBackTheWrittenMutes) {
    LayerDoc doc;
    EXPECT_EQ(globallyMuted(kRoot, doc), Layers());
    EXPECT_TRUE(globalMuteEdits(kRoot, doc, kAnim, false).empty());
    mustApply(doc, globalMuteEdits(kRoot, doc, kAnim, true));
    mustApply(doc, globalMuteEdits(kRoot, doc, kSet, true));
    EXPECT_EQ(globallyMuted(kRoot, doc), (Layers{kAnim, kSet}));
    mustApply(doc, globalMuteEdits(kRoot, doc, kAnim, false));
    EXPECT_EQ(globallyMuted(kRoot, doc), Layers{kSet});
}

TEST(GlobalMuteness, MU1ReadsAndKeepsTheKeysOfOthers) {
    LayerDoc doc;
    mustApply(doc,
              {entry("anim.usda", boolValue(true)), entry("../../sets/./set.usd", boolValue(true)),
               entry("../../../outside.usda", boolValue(true)), entry("", boolValue(true)),
               entry("/absolute.usda", boolValue(true)), entry("./off.usda", boolValue(false)),
               entry("./odd.usda", doubleValue(1))});
    EXPECT_EQ(globallyMuted(kRoot, doc), (Layers{kAnim, kSet}));
    mustApply(doc, globalMuteEdits(kRoot, doc, kAnim, false));
    mustApply(doc, globalMuteEdits(kRoot, doc, kAnim, true));
    EXPECT_TRUE(globalMuteEdits(kRoot, doc, kAnim, true).empty());
    const auto edits = globalMuteEdits(kRoot, doc, kAnim, false);
    ASSERT_EQ(edits.size(), 1u);
    EXPECT_EQ(edits[0], entry("anim.usda", boolValue(false)));
}

TEST(GlobalMuteness, MU1AppliesToARootLayerInTheTopFolder) {
    LayerDoc doc;
    mustApply(doc, globalMuteEdits({"root.usda"}, doc, {"sub/a.usda"}, true));
    EXPECT_EQ(globallyMuted({"root.usda"}, doc), Layers{{"sub/a.usda"}});
}

}  // namespace
}  // namespace usdlive
