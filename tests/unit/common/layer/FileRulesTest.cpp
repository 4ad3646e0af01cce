// Tests the rules for content that a file can hold (ED8-ED12).
#include "usdlive/common/layer/FileRules.h"

#include <gtest/gtest.h>

#include "RandomEdits.h"
#include "usdlive/common/core/ByteStream.h"
#include "usdlive/common/layer/TransactionExecutor.h"

using namespace usdlive;

namespace {

const LayerId kSaved{"a.usda"};

SetField typeIs(std::string_view name) { return {"typeName", {}, tokenValue(name), {}}; }
SetField sample(double time, Value value) {
    return {"timeSamples", SampleTime{time}, std::move(value), {}};
}
SetField defaultIs(Value value) { return {"default", {}, std::move(value), {}}; }

// A layer with the attribute /A.x, and authors who have seen only its first content.
class FileRules : public ::testing::Test {
protected:
    FileRules() {
        submit(0, {edit("/A", CreateSpec{SpecKind::Prim}),
                   edit("/A.x", CreateSpec{SpecKind::Attribute}), edit("/A.x", typeIs("double"))});
    }
    static Edit edit(std::string path, EditAction action) {
        return {kSaved, {std::move(path), {}}, std::move(action)};
    }
    Outcome submit(Revision base, std::vector<Edit> edits) {
        OwnCreations creations;
        Outcome outcome = execute(layers, log, creations,
                                  {{{"someone"}, 1}, base, 0, std::move(edits)}, revision + 1);
        if (std::holds_alternative<Executed>(outcome)) ++revision;
        return outcome;
    }
    std::vector<ErrorCode> dropped(std::vector<Edit> edits) {
        std::vector<ErrorCode> reasons;
        const Outcome outcome = submit(1, std::move(edits));
        EXPECT_TRUE(std::holds_alternative<Executed>(outcome));
        for (const auto& drop : std::get<Executed>(outcome).dropped) reasons.push_back(drop.reason);
        return reasons;
    }
    bool isRefused(std::vector<Edit> edits) {
        const std::string before = layers[kSaved].dump();
        const bool refused = std::holds_alternative<Refused>(submit(1, std::move(edits)));
        EXPECT_EQ(layers[kSaved].dump() == before, refused);
        return refused;
    }
    const FieldValue* field(const std::string& name, const std::string& path = "/A.x") {
        return layers[kSaved].field(path, name);
    }

    LayerDocs layers{{kSaved, {}}};
    NamespaceLog log;
    Revision revision = 0;
};

const Value kInt = intValue(1), kDouble = doubleValue(1), kString = stringValue("s");

}  // namespace

TEST_F(FileRules, ED8ATypeNameHasTheFormOfTheTextFormat) {
    for (const auto* name :
         {"", "My Type", "a:b", "1a", "None", "rel", "custom", "a[][]", "a.b", "[]", "a::", "a\n"})
        EXPECT_TRUE(isRefused(
            {edit("/A", SetField{"comment", {}, kString, {}}), edit("/A.x", typeIs(name))}))
            << name;
    for (const auto* name : {"float", "color3f[]", "ns::Type", "\xC3\xA4"})
        EXPECT_FALSE(isRefused({edit("/A.x", typeIs(name))})) << name;
    for (const auto* name : {"My Type", "None", "class", "a[]", "a::b"})
        EXPECT_TRUE(isRefused({edit("/A", typeIs(name))})) << name;
    for (const auto* name : {"Xform", "a.b", ""})
        EXPECT_FALSE(isRefused({edit("/A", typeIs(name))})) << name;
    EXPECT_TRUE(isRefused({edit("/A.x", EraseField{"typeName", {}})}));
    EXPECT_FALSE(isRefused({edit("/A", EraseField{"typeName", {}})}));
}

TEST_F(FileRules, ED9AValueOfAnotherTypeThanTheAttributesIsDropped) {
    using Drops = std::vector<ErrorCode>;
    const Drops one{ErrorCode::SpecKindConflict};
    EXPECT_EQ(dropped({edit("/A.x", defaultIs(kString))}), one);
    EXPECT_EQ(dropped({edit("/A.x", sample(1, kString)), edit("/A.x", sample(2, kDouble))}), one);
    EXPECT_EQ(dropped({edit("/A.x", defaultIs(kInt))}), Drops()) << "the texts are equal";
    EXPECT_EQ(dropped({edit("/A.x", defaultIs(Value(ValueType::Block, Bytes{})))}), Drops());
    // The order of the edits of one frame does not matter.
    EXPECT_EQ(dropped({edit("/A.x", defaultIs(kString)), edit("/A.x", typeIs("string"))}), Drops());
    EXPECT_EQ(*field("default"), FieldValue(kString));
    EXPECT_EQ(dropped({edit("/A.x", defaultIs(kDouble))}), one) << "its author saw a double";
}

TEST_F(FileRules, ED9AValueIsErasedWhenItsTypeChanges) {
    ASSERT_TRUE(
        dropped({edit("/A.x", defaultIs(kDouble)), edit("/A.x", sample(1, kDouble))}).empty());
    const Outcome outcome = submit(1, {edit("/A.x", typeIs("string")), edit("/A", DeleteSpec{}),
                                       edit("/Nothing", defaultIs(kInt))});
    EXPECT_EQ(std::get<Executed>(outcome).edits.size(), 2u) << "nothing is left to erase";

    submit(revision, {edit("/A", CreateSpec{SpecKind::Prim}),
                      edit("/A.x", CreateSpec{SpecKind::Attribute}), edit("/A.x", typeIs("double")),
                      edit("/A.x", defaultIs(kDouble)), edit("/A.x", sample(1, kDouble))});
    const Revision base = revision;
    // The erasing edits follow the submitted ones, and address the attribute at its new place.
    const Outcome retyped =
        submit(base, {edit("/A.x", typeIs("string")), edit("/A", MoveSpec{{"/", {}}, "B"}),
                      edit("/B.y", defaultIs(kInt)), edit("/A", SetField{"comment", {}, kString})});
    const auto& executed = std::get<Executed>(retyped);
    ASSERT_EQ(executed.edits.size(), 5u);
    EXPECT_EQ(executed.edits[3].edit, edit("/B.x", EraseField{"default", {}}));
    EXPECT_EQ(executed.edits[4].edit, edit("/B.x", EraseField{"timeSamples", {}}));
    EXPECT_EQ(field("default", "/B.x"), nullptr);
}

TEST_F(FileRules, ED10AFieldThatNoTextHoldsIsAbsent) {
    const auto item = [](const char* name) {
        return ListItem{ListName::Explicit, stringValue(name), {}};
    };
    for (const auto* name : {"a", "b"})
        ASSERT_TRUE(
            dropped({edit("/A", SetField{"variantSetNames", item(name), {}, ValueType::String})})
                .empty());
    for (const auto* name : {"a", "b"})
        ASSERT_TRUE(dropped({edit("/A", EraseField{"variantSetNames", item(name)})}).empty());
    EXPECT_EQ(field("variantSetNames", "/A"), nullptr);
    const ListOp none{ValueType::String, false, {}}, explicitly{ValueType::String, true, {}};
    const auto becomes = [&](const std::string& name, const FieldValue& value) {
        EXPECT_TRUE(dropped({edit("/A", SetField{name, {}, value, {}})}).empty());
        return field(name, "/A") != nullptr;
    };
    EXPECT_FALSE(becomes("variantSetNames", explicitly));
    EXPECT_FALSE(becomes("apiSchemas", none));
    EXPECT_TRUE(becomes("apiSchemas", explicitly)) << "None is a list that is empty";
    EXPECT_FALSE(becomes("variantSelection", Map{ValueType::String, {}}));
    EXPECT_TRUE(becomes("customData", Dictionary{}));
}

TEST_F(FileRules, ED12NoTextHoldsANul) {
    using namespace std::string_literals;
    const auto refused = [&](FieldPart part, FieldValue value, ValueType form = ValueType::None) {
        return isRefused(
            {edit("/A", SetField{"customData", std::move(part), std::move(value), form})});
    };
    for (const bool hasNul : {false, true}) {
        const std::string text = hasNul ? "a\0b"s : "a b"s;
        const Value string = stringValue(text);
        Bytes array, vector, unregistered;
        appendNumber<std::uint64_t>(array, 2);
        appendText(array, "before");
        appendText(array, text);
        appendNumber<std::uint32_t>(vector, 2);
        appendText(vector, "before");
        appendText(vector, text);
        unregistered.push_back(0);
        appendText(unregistered, text);
        EXPECT_EQ(refused({}, string), hasNul);
        EXPECT_EQ(refused({}, Value(arrayOf(ValueType::String), array)), hasNul);
        EXPECT_EQ(refused({}, Value(ValueType::StringVector, vector)), hasNul);
        EXPECT_EQ(refused({}, Value(ValueType::Unregistered, unregistered)), hasNul);
        Dictionary inner, values, keys;
        inner.entries["k"] = string;
        values.entries["in"] = inner;
        keys.entries[text] = kInt;
        EXPECT_EQ(refused({}, values), hasNul);
        EXPECT_EQ(refused({}, keys), hasNul);
        EXPECT_EQ(refused(DictionaryKey{{"a", text}}, kInt), hasNul);
        EXPECT_EQ(refused({}, TimeSamples{{{1.0, string}}}), hasNul);
        EXPECT_EQ(refused(SampleTime{2.0}, string), hasNul);
        EXPECT_EQ(refused({}, Map{ValueType::String, {{string, kInt}}}), hasNul);
        EXPECT_EQ(refused(MapKey{stringValue("k")}, string, ValueType::String), hasNul);
        EXPECT_EQ(refused(ListItem{ListName::Prepended, string, {}}, {}, ValueType::String),
                  hasNul);
        ListOp list{ValueType::String, false, {}};
        list[ListName::Deleted].push_back(string);
        EXPECT_EQ(refused({}, list), hasNul);
    }
    const Value kept = stringValue("a\0b"s);
    LayerDoc old;
    ASSERT_TRUE(old.apply("/A", CreateSpec{SpecKind::Prim}));
    EXPECT_TRUE(old.apply("/A", SetField{"documentation", {}, kept, {}})) << "of an old commit";
}

TEST_F(FileRules, ED11ADictionaryHasTheTypesOfAttributes) {
    const auto refused = [&](const Value& value) {
        Dictionary inner, outer;
        inner.entries["k"] = value;
        outer.entries["in"] = inner;
        const bool whole = isRefused({edit("/A", SetField{"customData", {}, outer, {}})});
        EXPECT_EQ(
            isRefused({edit("/A", SetField{"customData", DictionaryKey{{"a", "k"}}, value, {}})}),
            whole);
        return whole;
    };
    EXPECT_TRUE(refused(pathValue("/A")));
    EXPECT_TRUE(refused(Value(ValueType::Specifier, Bytes{0})));
    EXPECT_TRUE(refused(Value(ValueType::Block, Bytes{})));
    EXPECT_TRUE(refused(Value(ValueType::StringVector, Bytes(4, 0))));
    EXPECT_FALSE(refused(kInt));
    EXPECT_FALSE(refused(Value(arrayOf(ValueType::Token), Bytes(8, 0))));
}
