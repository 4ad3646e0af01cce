// Tests the inverses of edits.
#include "usdlive/common/layer/Inverse.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "RandomEdits.h"
#include "unit/Seeds.h"

using namespace usdlive;

namespace {

const auto kNoOthers = [](const FieldPart&) { return false; };

SetField sampleAt(double time, double value) {
    return {"timeSamples", SampleTime{time}, doubleValue(value)};
}
SetField keyAt(std::vector<std::string> path, const char* value) {
    return {"customData", DictionaryKey{std::move(path)}, stringValue(value)};
}
SetField listItem(const char* name, std::optional<Value> before = {}, ListName list = {}) {
    return {
        "apiSchemas", ListItem{list, tokenValue(name), std::move(before)}, {}, ValueType::Token};
}

// A layer with one prim, and the inverses of the edits that were applied to it.
class InverseTest : public ::testing::Test {
protected:
    void SetUp() override { ASSERT_TRUE(doc.apply("/A", CreateSpec{SpecKind::Prim})); }

    WrittenRegister write(const EditAction& action) {
        Inverse inverse = inverseBefore(doc, "/A", action);
        EXPECT_TRUE(doc.apply("/A", action));
        completeInverse(inverse, doc, "/A");
        return std::get<WrittenRegister>(inverse);
    }
    void apply(const EditAction& action) { ASSERT_TRUE(doc.apply("/A", action)); }
    // Returns false if the register was kept.
    bool restore(const WrittenRegister& written,
                 const std::function<bool(const FieldPart&)>& isOthers = kNoOthers) {
        const auto actions = restoredRegister(written, doc.field("/A", written.field), isOthers);
        if (!actions) return false;
        for (const EditAction& action : *actions) EXPECT_TRUE(doc.apply("/A", action));
        return true;
    }

    LayerDoc doc;
};

}  // namespace

TEST_F(InverseTest, APlainValueIsRestored) {
    const auto first = write(SetField{"comment", {}, stringValue("one")});
    const auto second = write(SetField{"comment", {}, stringValue("two")});
    EXPECT_TRUE(restore(second));
    EXPECT_EQ(*doc.field("/A", "comment"), FieldValue(stringValue("one")));
    EXPECT_TRUE(restore(first));
    EXPECT_EQ(doc.field("/A", "comment"), nullptr);
}

TEST_F(InverseTest, AnotherValueIsKept) {
    const auto written = write(SetField{"comment", {}, stringValue("one")});
    apply(SetField{"comment", {}, stringValue("others'")});
    EXPECT_FALSE(restore(written));
}

TEST_F(InverseTest, TheSameValueThatOthersHaveWrittenIsKept) {
    const auto written = write(SetField{"comment", {}, stringValue("one")});
    EXPECT_FALSE(restore(written, [](const FieldPart&) { return true; }));
}

TEST_F(InverseTest, ASampleIsRestoredBesideThoseOfOthers) {
    const auto written = write(sampleAt(1, 10));
    apply(sampleAt(2, 20));
    EXPECT_TRUE(restore(written));
    EXPECT_EQ(doc.field("/A", "timeSamples")->as<TimeSamples>()->samples.size(), 1u);
    EXPECT_EQ(contentOf(doc.field("/A", "timeSamples"), SampleTime{1}), std::nullopt);
}

TEST_F(InverseTest, TheFirstSampleGoesWithItsField) {
    const auto written = write(sampleAt(1, 10));
    EXPECT_TRUE(restore(written));
    EXPECT_EQ(doc.field("/A", "timeSamples"), nullptr);
}

TEST_F(InverseTest, AKeyIsRestoredBesideThoseOfOthers) {
    const auto written = write(keyAt({"a", "b"}, "mine"));
    apply(keyAt({"a", "c"}, "theirs"));
    EXPECT_TRUE(restore(written));
    EXPECT_EQ(contentOf(doc.field("/A", "customData"), DictionaryKey{{"a", "b"}}), std::nullopt);
    EXPECT_NE(contentOf(doc.field("/A", "customData"), DictionaryKey{{"a", "c"}}), std::nullopt);
}

TEST_F(InverseTest, AValueInThePlaceOfADictionaryIsRestored) {
    apply(keyAt({"a"}, "value"));
    const LayerDoc before = doc;
    const auto written = write(keyAt({"a", "b"}, "mine"));
    EXPECT_TRUE(restore(written));
    EXPECT_EQ(doc, before);
}

TEST_F(InverseTest, AListItemIsRestoredAtItsPlace) {
    for (const char* name : {"a", "b", "c"}) apply(listItem(name));
    const LayerDoc before = doc;
    const auto erased = write(EraseField{"apiSchemas", ListItem{{}, tokenValue("b"), {}}});
    const auto moved = write(listItem("c", tokenValue("a")));
    EXPECT_TRUE(restore(moved));
    EXPECT_TRUE(restore(erased));
    EXPECT_EQ(doc.dump(), before.dump());
}

TEST_F(InverseTest, AListOfAnotherFormIsRestored) {
    apply(listItem("a", {}, ListName::Prepended));
    const LayerDoc before = doc;
    const auto written = write(listItem("b"));  // explicit: the other lists are emptied
    EXPECT_TRUE(restore(written));
    EXPECT_EQ(doc.dump(), before.dump());
    const auto again = write(listItem("b"));
    apply(listItem("theirs"));
    EXPECT_TRUE(restore(again)) << "only the own item goes";
    EXPECT_EQ(doc.field("/A", "apiSchemas")->as<ListOp>()->lists[0].size(), 1u);
}

TEST_F(InverseTest, AFieldThatWasWrittenAsAWholeIsRestoredPartByPart) {
    apply(keyAt({"old"}, "value"));
    Dictionary mine;
    mine.entries = {{"a", stringValue("1")}, {"b", stringValue("2")}};
    const auto written = write(SetField{"customData", {}, mine});
    apply(keyAt({"b"}, "theirs"));
    EXPECT_TRUE(restore(written,
                        [](const FieldPart& part) { return overlap(part, DictionaryKey{{"b"}}); }));
    const auto* field = doc.field("/A", "customData");
    EXPECT_EQ(contentOf(field, DictionaryKey{{"a"}}), std::nullopt);
    EXPECT_EQ(contentOf(field, DictionaryKey{{"b"}}), FieldValue(stringValue("theirs")));
    EXPECT_EQ(contentOf(field, DictionaryKey{{"old"}}), FieldValue(stringValue("value")));
}

TEST_F(InverseTest, AMapKeepsTheOrderOfItsEntries) {
    const auto relocate = [](const char* from) {
        return SetField{"relocates", MapKey{pathValue(from)}, pathValue("/B"), ValueType::Path};
    };
    for (const char* from : {"/A/x", "/A/y", "/A/z"}) apply(relocate(from));
    const LayerDoc before = doc;
    const auto written = write(EraseField{"relocates", MapKey{pathValue("/A/y")}});
    EXPECT_TRUE(restore(written));
    EXPECT_EQ(doc.dump(), before.dump());
}

TEST_F(InverseTest, DeletedSpecsAreKeptAlthoughTheDocChanges) {
    apply(SetField{"comment", {}, stringValue("one")});
    ASSERT_TRUE(doc.apply("/A/B", CreateSpec{SpecKind::Prim}));
    ASSERT_TRUE(doc.apply("/A{s=}", CreateSpec{SpecKind::VariantSet}));
    ASSERT_TRUE(doc.apply("/A{s=v}", CreateSpec{SpecKind::Variant}));
    ASSERT_TRUE(doc.apply("/A{s=v}P", CreateSpec{SpecKind::Prim}));
    const LayerDoc before = doc;
    const Inverse inverse = inverseBefore(doc, "/A", DeleteSpec{});
    ASSERT_TRUE(doc.apply("/A", DeleteSpec{}));
    ASSERT_TRUE(doc.apply("/C", CreateSpec{SpecKind::Prim}));
    ASSERT_TRUE(doc.apply("/C", DeleteSpec{}));
    for (const auto& [path, action] : restoredSpecs(std::get<DeletedSpec>(inverse).content, "/A"))
        ASSERT_TRUE(doc.apply(path, action)) << path;
    EXPECT_EQ(doc.dump(), before.dump());
}

// Any registers that are written one after the other are restored in reverse order, exactly.
TEST(InverseProperty, WritesAreTakenBackExactly) {
    for (unsigned seed = 1; seed <= seedsOf(400); ++seed) {
        SCOPED_TRACE(seed);
        RandomEdits random(seed);
        LayerDoc doc;
        const auto next = [&](bool ofNamespace) {
            auto edit = random.edit(doc);
            while ((edit.second.index() < 4) != ofNamespace) edit = random.edit(doc);
            return edit;
        };
        for (int step = 0; step < 20; ++step) {
            const auto [path, action] = next(step % 2 == 0);
            (void)doc.apply(path, action);
        }
        const std::string before = doc.dump();
        bool isWritable = !hasRepeatedItems(doc);
        std::vector<std::pair<std::string, WrittenRegister>> written;
        for (int step = 0; step < 30; ++step) {
            const auto [path, action] = next(false);
            Inverse inverse = inverseBefore(doc, path, action);
            if (!doc.apply(path, action)) continue;
            isWritable = isWritable && !hasRepeatedItems(doc);
            completeInverse(inverse, doc, path);
            const auto& one = std::get<WrittenRegister>(inverse);
            if (one.changed) written.emplace_back(path, one);
        }
        if (!isWritable) continue;
        for (auto one = written.rbegin(); one != written.rend(); ++one) {
            const auto& [path, inverse] = *one;
            const auto actions =
                restoredRegister(inverse, doc.field(path, inverse.field), kNoOthers);
            ASSERT_TRUE(actions) << path << " " << inverse.field;
            for (const EditAction& action : *actions) ASSERT_TRUE(doc.apply(path, action));
        }
        ASSERT_EQ(doc.dump(), before);
    }
}
