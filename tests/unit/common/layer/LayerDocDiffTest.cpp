// Tests difference(): the edits that turn one LayerDoc into another.
#include <gtest/gtest.h>

#include <algorithm>

#include "MustApply.h"
#include "RandomEdits.h"
#include "unit/Seeds.h"
#include "usdlive/common/layer/LayerDoc.h"

using namespace usdlive;

namespace {

using DiffEdits = std::vector<std::pair<std::string, EditAction>>;

LayerDoc docWith(const std::vector<std::string>& prims) {
    LayerDoc doc;
    for (const auto& path : prims) mustApply(doc, path, CreateSpec{SpecKind::Prim});
    return doc;
}

// Returns the difference, and checks that its edits apply without errors and result in `to`, order
// included.
DiffEdits checkedDifference(const LayerDoc& from, const LayerDoc& to) {
    const auto edits = difference(from, to);
    LayerDoc trial = from;
    for (const auto& [path, action] : edits) {
        const auto applied = trial.apply(path, action);
        EXPECT_TRUE(applied) << path << ": " << applied.error().message;
    }
    EXPECT_EQ(trial.dump(), to.dump());
    EXPECT_TRUE(trial == to);
    return edits;
}

template <class Action>
std::size_t countOf(const DiffEdits& edits) {
    return static_cast<std::size_t>(std::count_if(edits.begin(), edits.end(), [](const auto& e) {
        return std::holds_alternative<Action>(e.second);
    }));
}

void checkFieldDifference(const FieldValue* from, const FieldValue* to) {
    LayerDoc before = docWith({"/A"});
    LayerDoc after = before;
    if (from) mustApply(before, "/A", SetField{"f", {}, *from, ValueType::None});
    if (to) mustApply(after, "/A", SetField{"f", {}, *to, ValueType::None});
    LayerDoc authored = before;
    for (const auto& action : fieldDifference("f", from, to)) mustApply(before, "/A", action);
    EXPECT_EQ(before.dump(), after.dump());
    for (const auto& action : authoredParts("f", from, to)) mustApply(authored, "/A", action);
    EXPECT_EQ(authored.dump(), after.dump());
}

ListOp tokens(const std::string& items) {
    ListOp op{ValueType::Token, true, {}};
    for (const char item : items)
        op[ListName::Explicit].push_back(tokenValue(std::string(1, item)));
    return op;
}

}  // namespace

TEST(LayerDocDiff, EqualDocsHaveNone) {
    const LayerDoc doc = docWith({"/A", "/A/B"});
    EXPECT_TRUE(difference(doc, doc).empty());
    EXPECT_TRUE(difference(doc, docWith({"/A", "/A/B"})).empty());
}

TEST(LayerDocDiff, ARenameIsOneMove) {
    const LayerDoc from = docWith({"/A", "/A/B", "/A/C"});
    LayerDoc to = from;
    mustApply(to, "/A", MoveSpec{{"/", {}}, "Z"});
    const auto edits = checkedDifference(from, to);
    ASSERT_EQ(edits.size(), 1U);
    EXPECT_EQ(edits[0].second, EditAction(MoveSpec{{"/", {}}, "Z"}));
}

TEST(LayerDocDiff, SwapsNames) {
    const LayerDoc from = docWith({"/A", "/A/x", "/B", "/B/y"});
    LayerDoc to = from;
    mustApply(to, "/A", MoveSpec{{"/", {}}, "T"});
    mustApply(to, "/B", MoveSpec{{"/", {}}, "A"});
    mustApply(to, "/T", MoveSpec{{"/", {}}, "B"});
    const auto edits = checkedDifference(from, to);
    EXPECT_EQ(edits.size(), 3U);
    EXPECT_EQ(countOf<MoveSpec>(edits), 3U);
}

TEST(LayerDocDiff, SwapsParentAndChild) {
    const LayerDoc from = docWith({"/A", "/A/B"});
    LayerDoc to = from;
    mustApply(to, "/A/B", MoveSpec{{"/", {}}, "T"});
    mustApply(to, "/A", MoveSpec{{"/T", {}}, "B"});
    mustApply(to, "/T", MoveSpec{{"/", {}}, "A"});
    EXPECT_EQ(countOf<CreateSpec>(checkedDifference(from, to)), 0U);
}

TEST(LayerDocDiff, MovesIntoACreatedParent) {
    const LayerDoc from = docWith({"/A", "/A/B"});
    LayerDoc to = from;
    mustApply(to, "/N", CreateSpec{SpecKind::Prim});
    mustApply(to, "/N/M", CreateSpec{SpecKind::Prim});
    mustApply(to, "/A/B", MoveSpec{{"/N/M", {}}, "B"});
    const auto edits = checkedDifference(from, to);
    EXPECT_EQ(edits.size(), 3U);
}

TEST(LayerDocDiff, MovesOutOfADeletedSubtree) {
    const LayerDoc from = docWith({"/A", "/A/B", "/A/B/C", "/D"});
    LayerDoc to = from;
    mustApply(to, "/A/B/C", MoveSpec{{"/D", {}}, "C"});
    mustApply(to, "/A", DeleteSpec{});
    const auto edits = checkedDifference(from, to);
    EXPECT_EQ(edits.size(), 2U);
    EXPECT_EQ(countOf<MoveSpec>(edits), 1U);
}

TEST(LayerDocDiff, ASpecInTheWayMovesWithItsWantedChildren) {
    const LayerDoc from = docWith({"/A", "/A/x", "/B", "/C"});
    LayerDoc to = from;
    mustApply(to, "/A/x", MoveSpec{{"/C", {}}, "x"});
    mustApply(to, "/A", DeleteSpec{});
    mustApply(to, "/B", MoveSpec{{"/", {}}, "A"});
    EXPECT_EQ(countOf<CreateSpec>(checkedDifference(from, to)), 0U);
}

TEST(LayerDocDiff, APlaceTakenByANewSpecOfTheSameKindIsEditedInPlace) {
    const LayerDoc from = docWith({"/A", "/A/B"});
    LayerDoc to = from;
    mustApply(to, "/A", DeleteSpec{});
    mustApply(to, "/A", CreateSpec{SpecKind::Prim});
    mustApply(to, "/A/C", CreateSpec{SpecKind::Prim});
    const auto edits = checkedDifference(from, to);
    EXPECT_EQ(edits.size(), 2U);  // creates C, deletes B, keeps A
}

TEST(LayerDocDiff, AnotherKindIsDeletedAndCreated) {
    LayerDoc from = docWith({"/A"});
    LayerDoc to = from;
    mustApply(from, "/A.x", CreateSpec{SpecKind::Attribute});
    mustApply(to, "/A.x", CreateSpec{SpecKind::Relationship});
    EXPECT_EQ(checkedDifference(from, to).size(), 2U);
}

TEST(LayerDocDiff, MovesAsFewChildrenAsOrderNeeds) {
    LayerDoc from;
    for (const char* name : {"/a", "/b", "/c", "/d", "/e", "/f"})
        mustApply(from, name, CreateSpec{SpecKind::Prim});
    LayerDoc to = from;
    mustApply(to, "/e", PlaceSpec{"b"});
    const auto edits = checkedDifference(from, to);
    ASSERT_EQ(edits.size(), 1U);
    EXPECT_EQ(edits[0], (std::pair<std::string, EditAction>("/e", PlaceSpec{"b"})));
}

TEST(LayerDocDiff, LooksOnlyWhereStructureIsNotShared) {
    LayerDoc from;
    for (int i = 0; i < 1000; ++i)
        mustApply(from, "/p" + std::to_string(i), CreateSpec{SpecKind::Prim});
    LayerDoc to = from;
    mustApply(to, "/p500", setInt("f", 1));
    mustApply(to, "/p999", MoveSpec{{"/p3", {}}, "q"});
    mustApply(to, "/new", CreateSpec{SpecKind::Prim});
    mustApply(to, "/new", PlaceSpec{"p7"});
    EXPECT_EQ(checkedDifference(from, to).size(), 4U);
}

// Ids may mean different specs in the two docs. This may cost edits, but must not change the
// result.
TEST(LayerDocDiff, LeadsFromAnyDocToAnyOther) {
    for (unsigned seed = 0; seed < seedsOf(3000); ++seed) {
        SCOPED_TRACE(seed);
        RandomEdits random{seed};
        LayerDoc ancestor;
        random.editTimes(ancestor, 60);
        LayerDoc from = ancestor;
        LayerDoc to = ancestor;
        random.editTimes(from, static_cast<int>(random.below(30)));
        if (seed % 2) to.reserveIds(from.nextId());
        random.editTimes(to, static_cast<int>(random.below(30)));
        checkedDifference(from, to);
        if (HasFailure()) return;
    }
}

TEST(LayerDocDiff, WithDistinctIdsNoExistingSpecIsCreated) {
    for (unsigned seed = 0; seed < 1000; ++seed) {
        SCOPED_TRACE(seed);
        RandomEdits random{seed};
        LayerDoc from;
        random.editTimes(from, 60);
        LayerDoc to = from;
        std::size_t created = 0;
        for (int i = 0; i < 20; ++i) {
            const auto [path, action] = random.edit(to);
            const bool variant =
                to.kind(path) == SpecKind::Variant || to.kind(path) == SpecKind::VariantSet;
            if (variant || std::holds_alternative<DeleteSpec>(action)) continue;
            const auto applied = to.apply(path, action);
            if (applied && applied->changed && std::holds_alternative<CreateSpec>(action))
                ++created;
        }
        EXPECT_LE(countOf<CreateSpec>(checkedDifference(from, to)), created);
        if (HasFailure()) return;
    }
}

TEST(FieldDifference, M1FindsOneDictionaryKey) {
    Dictionary inner;
    inner.entries["x"] = intValue(1);
    inner.entries["y"] = intValue(2);
    Dictionary from;
    from.entries["a"] = inner;
    Dictionary to = from;
    std::get<Dictionary>(to.entries["a"]).entries["x"] = intValue(3);
    const FieldValue old = from;
    const FieldValue now = to;
    const std::vector<EditAction> expected{
        SetField{"f", DictionaryKey{{"a", "x"}}, intValue(3), ValueType::None}};
    EXPECT_EQ(fieldDifference("f", &old, &now), expected);
}

TEST(FieldDifference, M1FindsOneSample) {
    const FieldValue from = TimeSamples{{{1, intValue(1)}, {2, intValue(2)}}};
    const FieldValue to = TimeSamples{{{1, intValue(1)}, {1.5, intValue(7)}, {2, intValue(2)}}};
    const std::vector<EditAction> expected{
        SetField{"f", SampleTime{1.5}, intValue(7), ValueType::None}};
    EXPECT_EQ(fieldDifference("f", &from, &to), expected);
}

TEST(FieldDifference, M1FindsOneItemPutInFront) {
    const FieldValue from = tokens("abcdef");
    const FieldValue to = tokens("xabcdef");
    const auto actions = fieldDifference("f", &from, &to);
    ASSERT_EQ(actions.size(), 1U);
    const auto& item = std::get<ListItem>(std::get<SetField>(actions[0]).part);
    EXPECT_EQ(item, (ListItem{ListName::Explicit, tokenValue("x"), tokenValue("a")}));
}

TEST(FieldDifference, IsTheWholeFieldWhenNothingIsCommon) {
    const FieldValue from = tokens("abc");
    const FieldValue to = tokens("def");
    const std::vector<EditAction> expected{SetField{"f", {}, to, ValueType::None}};
    EXPECT_EQ(fieldDifference("f", &from, &to), expected);
}

TEST(FieldDifference, IsTheWholeFieldWhenAListHasDuplicates) {
    const FieldValue from = tokens("abc");
    const FieldValue to = tokens("abca");
    const std::vector<EditAction> expected{SetField{"f", {}, to, ValueType::None}};
    EXPECT_EQ(fieldDifference("f", &from, &to), expected);
    checkFieldDifference(&from, &to);
    checkFieldDifference(&to, &from);
}

TEST(FieldDifference, M1AnAuthorSendsPartsAlsoWhereTheWholeIsShorter) {
    const auto partsOf = [](const FieldValue* from, const FieldValue& to) {
        std::vector<FieldPart> parts;
        for (const auto& action : authoredParts("f", from, &to))
            parts.push_back(std::visit(
                [](const auto& edit) {
                    if constexpr (requires { edit.part; }) return FieldPart(edit.part);
                    return FieldPart();
                },
                action));
        return parts;
    };
    Dictionary links, inner;
    inner.entries["x"] = inner.entries["y"] = intValue(1);
    links.entries["a"] = inner;
    const std::vector<FieldPart> keys{DictionaryKey{{"a", "x"}}, DictionaryKey{{"a", "y"}}};
    const FieldValue other = intValue(1);
    EXPECT_EQ(partsOf(nullptr, links), keys);
    EXPECT_EQ(partsOf(&other, links), keys);
    EXPECT_EQ(
        partsOf(nullptr, tokens("ab")),
        (std::vector<FieldPart>{ListItem{ListName::Explicit, tokenValue("b"), {}},
                                ListItem{ListName::Explicit, tokenValue("a"), tokenValue("b")}}));
    ListOp prepended{ValueType::Token, false, {}};
    prepended[ListName::Prepended] = {tokenValue("a")};
    const FieldValue explicitly = tokens("a");
    EXPECT_EQ(partsOf(&explicitly, prepended),
              (std::vector<FieldPart>{ListItem{ListName::Prepended, tokenValue("a"), {}}}));
    EXPECT_EQ(partsOf(nullptr, TimeSamples{{{1, intValue(1)}, {2, intValue(1)}}}),
              (std::vector<FieldPart>{SampleTime{1}, SampleTime{2}}));
    EXPECT_EQ(partsOf(nullptr, Map{ValueType::String, {{stringValue("s"), stringValue("v")}}}),
              (std::vector<FieldPart>{MapKey{stringValue("s")}}));
    // There is no part to send.
    const std::vector<FieldPart> whole(1);
    EXPECT_EQ(partsOf(nullptr, Dictionary{}), whole);
    EXPECT_EQ(partsOf(&explicitly, tokens("")), whole);
    EXPECT_EQ(partsOf(nullptr, tokens("aa")), whole);
    // So many parts would be longer than the whole field.
    TimeSamples many;
    for (int time = 0; time < 5000; ++time) many.samples.emplace(time, intValue(1));
    EXPECT_EQ(partsOf(nullptr, many), whole);
}

TEST(FieldDifference, M13MergesThePartsOfTwoAuthors) {
    RandomEdits random{11};
    for (int step = 0; step < 2000; ++step) {
        SCOPED_TRACE(step);
        const FieldValue present = random.content(), added = random.content();
        const FieldValue united = unitedParts("f", present, added);
        if (present.type() != added.type()) {
            EXPECT_EQ(united, added);
        }
        // Adding these parts to that list changes nothing.
        const auto* list = added.as<ListOp>();
        if (!list) {
            EXPECT_EQ(unitedParts("f", united, added), united);
        }
        const auto* both = united.as<Dictionary>();
        if (!both || !present.as<Dictionary>() || added.as<Dictionary>()->entries.empty()) continue;
        for (const auto* from : {present.as<Dictionary>(), added.as<Dictionary>()})
            for (const auto& [key, entry] : from->entries) EXPECT_TRUE(both->entries.contains(key));
    }
}

TEST(FieldDifference, M13MergesAlsoVeryManyParts) {
    const auto united = [](const auto& present, const auto& added) {
        return unitedParts("f", FieldValue(present), FieldValue(added));
    };
    TimeSamples samples, otherSamples;
    Dictionary keys, otherKeys;
    ListOp items{ValueType::Int, false, {}}, otherItems = items;
    for (int i = 0; i < 5000; ++i) {
        samples.samples.emplace(i, intValue(i));
        keys.entries["k" + std::to_string(i)] = intValue(i);
        items[ListName::Prepended].push_back(intValue(i));
    }
    otherSamples.samples.emplace(-1, intValue(7));
    otherKeys.entries["other"] = intValue(7);
    otherItems[ListName::Prepended].push_back(intValue(-1));
    EXPECT_EQ(united(otherSamples, samples).template as<TimeSamples>()->samples.size(), 5001u);
    EXPECT_EQ(united(otherKeys, keys).template as<Dictionary>()->entries.size(), 5001u);
    EXPECT_EQ((*united(otherItems, items).template as<ListOp>())[ListName::Prepended].size(),
              5001u);
}

TEST(FieldDifference, IsExactForAnyContents) {
    RandomEdits random{7};
    for (unsigned step = 0; step < seedsOf(20'000); ++step) {
        SCOPED_TRACE(step);
        const FieldValue from = random.content();
        FieldValue to = random.content();
        if (random.chance(2)) {  // a doc derived from `from`
            LayerDoc doc = docWith({"/A"});
            mustApply(doc, "/A", SetField{"f", {}, from, ValueType::None});
            for (std::size_t i = random.below(4); i > 0; --i)
                mustApply(doc, "/A", random.partEdit("f"));
            if (const auto* field = doc.field("/A", "f")) to = *field;
        }
        checkFieldDifference(&from, &to);
        if (step % 100 == 0) {
            checkFieldDifference(nullptr, &to);
            checkFieldDifference(&from, nullptr);
        }
        if (HasFailure()) return;
    }
}
