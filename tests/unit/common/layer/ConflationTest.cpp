// Tests the conflation of commits (CF1).
#include "usdlive/common/layer/Conflation.h"

#include <gtest/gtest.h>

#include "RandomEdits.h"

namespace usdlive {
namespace {

const LayerId kConflatedLayer{"a.usda"}, kSecondLayer{"b.usda"};

Edit set(const std::string& path, double value, const LayerId& layer = kConflatedLayer) {
    return {layer, {path, {}}, SetField{"default", {}, doubleValue(value), {}}};
}
Edit sample(double time, double value) {
    return {kConflatedLayer,
            {"/A.x", {}},
            SetField{"timeSamples", SampleTime{time}, doubleValue(value), {}}};
}
Edit key(std::vector<std::string> path, double value) {
    return {kConflatedLayer,
            {"/A", {}},
            SetField{"customData", DictionaryKey{std::move(path)}, doubleValue(value), {}}};
}

using Edits = std::vector<Edit>;

TEST(Conflation, CF1KeepsTheLastOfEachRegister) {
    EXPECT_EQ(
        conflated({set("/A.x", 1), set("/A.y", 1), set("/A.x", 2), set("/A.x", 3, kSecondLayer)}),
        (Edits{set("/A.y", 1), set("/A.x", 2), set("/A.x", 3, kSecondLayer)}));
    EXPECT_EQ(conflated({sample(1, 1), sample(2, 1), sample(1, 2)}),
              (Edits{sample(2, 1), sample(1, 2)}));
    EXPECT_EQ(conflated({key({"a"}, 1), key({"a", "b"}, 1), key({"a", "b"}, 2)}),
              (Edits{key({"a"}, 1), key({"a", "b"}, 2)}));
}

TEST(Conflation, CF1AWholeFieldCoversItsParts) {
    const Edit whole{kConflatedLayer, {"/A", {}}, EraseField{"customData", {}}};
    EXPECT_EQ(conflated({key({"a"}, 1), whole}), (Edits{whole}));
    EXPECT_EQ(conflated({whole, key({"a"}, 1)}), (Edits{whole, key({"a"}, 1)}));
    // Erasing a part does not change a field of another form. Therefore the edit that gave the
    // field this form must stay.
    const Edit part{kConflatedLayer, {"/A", {}}, EraseField{"customData", DictionaryKey{{"a"}}}};
    EXPECT_EQ(conflated({key({"a"}, 1), part}), (Edits{key({"a"}, 1), part}));
}

TEST(Conflation, CF1NothingIsDroppedAcrossNamespaceEdits) {
    const Edit move{kConflatedLayer, {"/A", {}}, MoveSpec{{"/", {}}, "B"}};
    EXPECT_EQ(conflated({set("/A.x", 1), move, set("/A.x", 2)}).size(), 3u);
    EXPECT_EQ(conflated({set("/A.x", 1, kSecondLayer), move, set("/A.x", 2, kSecondLayer)}).size(),
              2u)
        << "of another layer";
}

// After any edits, the result is the same layer.
TEST(Conflation, CF1LeadsToTheSameLayer) {
    std::size_t all = 0, left = 0;
    for (unsigned seed = 0; seed < 500; ++seed) {
        SCOPED_TRACE(seed);
        RandomEdits random(seed);
        LayerDoc begin;
        for (int step = 0; step < 40; ++step) {
            const auto [path, action] = random.edit(begin);
            (void)begin.apply(path, action);
        }
        LayerDoc doc = begin;
        Edits edits;
        for (int step = 0; step < 60; ++step) {
            auto [path, action] = random.edit(doc);
            // Most edits set values, so that the same values are set repeatedly.
            const bool isField = std::holds_alternative<SetField>(action) ||
                                 std::holds_alternative<EraseField>(action);
            if (!isField && !random.chance(20)) continue;
            if (doc.apply(path, action))
                edits.push_back({kConflatedLayer, {path, {}}, std::move(action)});
        }
        all += edits.size();
        edits = conflated(std::move(edits));
        left += edits.size();
        LayerDoc other = begin;
        for (const Edit& edit : edits)
            ASSERT_TRUE(other.apply(edit.address.path, edit.action)) << edit.address.path;
        ASSERT_EQ(other.dump(), doc.dump());
    }
    EXPECT_LT(left, all) << "and some of it was dropped";
}

}  // namespace
}  // namespace usdlive
