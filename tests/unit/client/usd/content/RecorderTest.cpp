// Tests Recorder: recording the edits of a command, and undoing them in a shared layer.
#include "usdlive/client/usd/content/Recorder.h"

#include <gtest/gtest.h>
#include <pxr/base/tf/stringUtils.h>
#include <pxr/base/vt/dictionary.h>
#include <pxr/usd/sdf/attributeSpec.h>
#include <pxr/usd/sdf/changeBlock.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/listOp.h>
#include <pxr/usd/sdf/primSpec.h>
#include <pxr/usd/sdf/reference.h>
#include <pxr/usd/sdf/relationshipSpec.h>
#include <pxr/usd/sdf/types.h>
#include <pxr/usd/sdf/variantSetSpec.h>
#include <pxr/usd/sdf/variantSpec.h>

#include <algorithm>
#include <ctime>
#include <functional>
#include <limits>
#include <random>

#include "usd/content/LayerEdits.h"
#include "usd/content/SpecEdits.h"

namespace usdlive::content {

using pxr::SdfLayerRefPtr;
using pxr::SdfPath;
using pxr::TfToken;
using pxr::VtValue;

namespace {

const TfToken kDefault("default"), kReferences("references"), kCustomData("customData");
const auto kShared = [](const pxr::SdfLayerHandle&) { return true; };
const auto kMine = [](const pxr::SdfLayerHandle&) { return false; };

std::string textOf(const SdfLayerRefPtr& layer) {
    std::string text;
    layer->ExportToString(&text);
    return text;
}

pxr::SdfPrimSpecHandle define(const SdfLayerRefPtr& layer, const SdfPath& path) {
    const auto prim = pxr::SdfCreatePrimInLayer(layer, path);
    prim->SetSpecifier(pxr::SdfSpecifierDef);
    return prim;
}

void setDefault(const SdfLayerRefPtr& layer, const SdfPath& path, double value) {
    pxr::SdfJustCreatePrimAttributeInLayer(layer, path, pxr::SdfValueTypeNames->Double);
    layer->SetField(path, kDefault, VtValue(value));
}

void prepend(const SdfLayerRefPtr& layer, const SdfPath& path, const std::string& target) {
    layer->GetPrimAtPath(path)->GetReferenceList().Prepend(pxr::SdfReference("", SdfPath(target)));
}

/// Makes an edit of each kind.
void edit(const SdfLayerRefPtr& layer, std::mt19937& random) {
    const std::vector<std::string> names{"A", "B", "C"};
    const auto name = [&] { return names[random() % names.size()]; };
    SdfPath path("/" + name());
    while (random() % 2) path = path.AppendChild(TfToken(name()));
    const auto prim = define(layer, path);
    const SdfPath attribute = path.AppendProperty(TfToken(random() % 2 ? "x" : "y"));
    switch (random() % 10) {
        case 0:
            return removeSpec(layer, path);
        case 1:
            return setDefault(layer, attribute, double(random() % 9));
        case 2:
            setDefault(layer, attribute, 0);
            return layer->SetTimeSample(attribute, double(random() % 4), double(random() % 9));
        case 3:
            return layer->SetFieldDictValueByKey(path, kCustomData, TfToken(name() + ":deep"),
                                                 VtValue(int(random() % 9)));
        case 4:
            return prepend(layer, path, "/" + name());
        case 5: {
            const SdfPath relationship = path.AppendProperty(TfToken("r"));
            pxr::SdfRelationshipSpecHandle spec = layer->GetRelationshipAtPath(relationship);
            if (!spec) spec = pxr::SdfRelationshipSpec::New(prim, "r", false);
            return spec->GetTargetPathList().Prepend(SdfPath("/" + name()));
        }
        case 6:
            pxr::SdfJustCreatePrimInLayer(layer, path.AppendVariantSelection("v", name()));
            return prim->SetVariantSelection("v", name());
        case 7:
            return layer->SetSubLayerPaths({"./" + name() + "1.usda", "./" + name() + "2.usda"});
        case 8:
            return layer->SetField(SdfPath::AbsoluteRootPath(), TfToken("documentation"),
                                   VtValue(name()));
        default:
            return setDefault(layer, attribute, std::numeric_limits<double>::quiet_NaN());
    }
}

SdfLayerRefPtr randomLayer(std::mt19937& random) {
    auto layer = pxr::SdfLayer::CreateAnonymous(".usda");
    for (int i = 0; i < 15; ++i) edit(layer, random);
    return layer;
}

class RecorderTest : public testing::Test {
protected:
    RecorderTest() {
        define(layer, prim);
        setDefault(layer, x, 0);
        prepend(layer, prim, "/Old");
        layer->SetSubLayerPaths({"./old.usda"});
        recorder.touch(layer, SdfPath::AbsoluteRootPath(), true);
    }

    [[nodiscard]] VtValue value(const SdfPath& path, const TfToken& field) const {
        return layer->GetField(path, field);
    }
    [[nodiscard]] int key(const char* name) const {
        return layer->GetFieldDictValueByKey(prim, kCustomData, TfToken(name))
            .GetWithDefault<int>(-1);
    }
    void setKey(const char* name, int number) {
        layer->SetFieldDictValueByKey(prim, kCustomData, TfToken(name), VtValue(number));
    }

    const SdfLayerRefPtr layer = pxr::SdfLayer::CreateAnonymous(".usda");
    const SdfPath prim{"/A"}, x{"/A.x"};
    Recorder recorder;
};

}  // namespace

TEST(Recorder, AnyRecordedEditIsUndoneExactly) {
    for (unsigned seed = 0; seed < 200; ++seed) {
        SCOPED_TRACE(seed);
        std::mt19937 random(seed);
        const auto layer = randomLayer(random);
        const auto before = textOf(layer);
        Recorder recorder;
        recorder.touch(layer, SdfPath::AbsoluteRootPath(), true);
        for (int i = 0; i < 10; ++i) edit(layer, random);
        const Record record = recorder.finish();
        EXPECT_TRUE(record.undo(seed % 2 ? Record::IsShared(kShared) : kMine).empty());
        EXPECT_EQ(textOf(layer), before);
    }
}

// A command removes, for example, a prim in which it has edited something before.
TEST(Recorder, EditsOfScopesThatContainEarlierOnesAreUndoneExactly) {
    for (unsigned seed = 0; seed < 200; ++seed) {
        SCOPED_TRACE(seed);
        std::mt19937 random(seed);
        const auto layer = randomLayer(random);
        for (const char* path : {"/A/B/C", "/A/B/A", "/A/C"}) define(layer, SdfPath(path));
        const auto before = textOf(layer);
        Recorder recorder;
        for (const char* path : {"/A/C", "/A/B/C", "/A/B", "/A", "/"}) {
            const SdfPath scope(path);
            if (random() % 2 && layer->GetPrimAtPath(scope)) {
                recorder.touch(layer, scope);
                layer->SetField(scope, TfToken("comment"), VtValue(std::string("touched")));
            }
            recorder.touch(layer, scope, true);
            for (int i = 0; i < 3 && layer->HasSpec(scope); ++i) {
                const SdfPath child = scope.AppendChild(TfToken(random() % 2 ? "A" : "B"));
                switch (random() % 4) {
                    case 0:
                        define(layer, child);
                        break;
                    case 1:
                        setDefault(layer, child.AppendProperty(TfToken("x")), double(random() % 9));
                        break;
                    case 2:
                        removeSpec(layer, child);
                        break;
                    default:
                        if (scope != SdfPath::AbsoluteRootPath()) removeSpec(layer, scope);
                }
            }
        }
        const Record record = recorder.finish();
        EXPECT_TRUE(record.undo(seed % 2 ? Record::IsShared(kShared) : kMine).empty());
        EXPECT_EQ(textOf(layer), before);
    }
}

// Edits of many siblings, each in a scope of its own that begins when others were edited already.
TEST(Recorder, EditsOfSiblingsInScopesOfTheirOwnAreUndoneExactly) {
    const std::vector<SdfPath> parents{SdfPath("/"), SdfPath("/P"), SdfPath("/P/Q"),
                                       SdfPath("/P{v=one}")};
    for (unsigned seed = 0; seed < 1'000; ++seed) {
        SCOPED_TRACE(seed);
        std::mt19937 random(seed);
        const auto parent = [&] { return parents[random() % parents.size()]; };
        const auto nameOf = [&] { return TfToken(std::string(1, char('a' + random() % 8))); };
        const auto layer = pxr::SdfLayer::CreateAnonymous(".usda");
        define(layer, SdfPath("/P/Q"));
        pxr::SdfJustCreatePrimInLayer(layer, SdfPath("/P{v=one}"));
        for (int i = 0; i < 24; ++i) define(layer, parent().AppendChild(nameOf()));
        const auto before = textOf(layer);

        Recorder recorder;
        for (auto count = 1 + random() % 12; count > 0; --count) {
            const SdfPath owner = parent(), path = owner.AppendChild(nameOf());
            const SdfPath other = owner.AppendChild(nameOf());
            const bool isThere = layer->HasSpec(path);
            switch (random() % 5) {
                case 0:
                    recorder.touchWithAncestors(layer, path);
                    define(layer, path)->SetTypeName("Sphere");
                    break;
                case 1:
                    if (!isThere || layer->HasSpec(other)) break;
                    for (const SdfPath& touched : {path, other})
                        recorder.touch(layer, touched, true);
                    moveSpec(layer, path, other);
                    break;
                case 2:
                    if (random() % 3 != 0) break;
                    recorder.touch(layer, owner, true);
                    if (owner.IsPrimPath()) removeSpec(layer, owner);
                    break;
                default:
                    if (!isThere) break;
                    recorder.touch(layer, path, true);
                    if (random() % 4 != 0) removeSpec(layer, path);
            }
        }
        const Record record = recorder.finish();
        EXPECT_TRUE(record.undo(seed % 2 ? Record::IsShared(kShared) : kMine).empty());
        EXPECT_EQ(textOf(layer), before);
    }
}

TEST(Recorder, SiblingsReturnToTheirPlacesAmongThoseThatSomebodyElseHasMoved) {
    const auto layer = pxr::SdfLayer::CreateAnonymous(".usda");
    const SdfPath root = SdfPath::AbsoluteRootPath();
    for (const char* path : {"/A", "/B", "/C", "/D", "/E"}) define(layer, SdfPath(path));
    Recorder recorder;
    for (const char* path : {"/B", "/C"}) {
        recorder.touch(layer, SdfPath(path), true);
        removeSpec(layer, SdfPath(path));
    }
    const Record record = recorder.finish();
    define(layer, SdfPath("/Theirs"));
    EXPECT_TRUE(record.undo(kShared).empty());
    const auto names = [](const std::string& text) {
        return pxr::TfToTokenVector(pxr::TfStringTokenize(text));
    };
    EXPECT_EQ(primChildren(layer, root), names("A B C D E Theirs"));
    for (const char* path : {"/B", "/C"}) removeSpec(layer, SdfPath(path));
    arrange(layer, root, names("Theirs E A"), {TfToken("Theirs"), TfToken("E")});
    EXPECT_TRUE(record.undo(kShared).empty());
    EXPECT_EQ(primChildren(layer, root), names("Theirs E A B C D"));
}

TEST(Recorder, AnUndoOfManySiblingsTakesTimeInProportion) {
    const SdfPath parent("/P");
    using Paths = std::vector<SdfPath>;
    using Step = std::function<void(Recorder&, const SdfLayerRefPtr&, const Paths&, const Paths&)>;
    const auto remove = [&](const SdfLayerRefPtr& layer, const Paths& paths) {
        removeSpecs(layer, parent, {paths.begin(), paths.end()});
    };
    const auto touch = [](Recorder& recorder, const SdfLayerRefPtr& layer, const Paths& paths) {
        for (const SdfPath& path : paths) recorder.touch(layer, path, true);
    };
    const std::map<std::string, Step> kinds{
        {"removed",
         [&](auto& recorder, const auto& layer, const auto& old, const auto&) {
             touch(recorder, layer, old);
             remove(layer, old);
         }},
        {"removed, half of them",
         [&](auto& recorder, const auto& layer, const auto& old, const auto&) {
             const Paths half(old.begin(), old.begin() + std::ptrdiff_t(old.size() / 2));
             touch(recorder, layer, half);
             remove(layer, half);
         }},
        {"removed in one scope, half of them",
         [&](auto& recorder, const auto& layer, const auto& old, const auto&) {
             recorder.touch(layer, parent, true);
             remove(layer, Paths(old.begin(), old.begin() + std::ptrdiff_t(old.size() / 2)));
         }},
        {"added",
         [&](auto& recorder, const auto& layer, const auto&, const auto& added) {
             touch(recorder, layer, added);
             for (const SdfPath& path : added) define(layer, path);
         }},
        {"added properties",
         [&](auto& recorder, const auto& layer, const auto&, const auto& added) {
             for (const SdfPath& path : added) {
                 const SdfPath property = parent.AppendProperty(path.GetNameToken());
                 recorder.touchWithAncestors(layer, property);
                 setDefault(layer, property, 1);
             }
         }},
        {"renamed",
         [&](auto& recorder, const auto& layer, const auto& old, const auto& added) {
             touch(recorder, layer, old);
             touch(recorder, layer, added);
             for (const SdfPath& path : added) define(layer, path);
             remove(layer, old);
         }},
    };
    const auto cost = [&](const Step& edit, const Record::IsShared& isShared, int count) {
        const auto layer = pxr::SdfLayer::CreateAnonymous(".usda");
        const pxr::SdfChangeBlock block;
        define(layer, parent);
        Paths old, added;
        for (int i = 0; i < count; ++i) {
            old.push_back(parent.AppendChild(TfToken("old" + std::to_string(i))));
            added.push_back(parent.AppendChild(TfToken("new" + std::to_string(i))));
            define(layer, old.back());
        }
        const auto before = textOf(layer);
        const auto start = std::clock();
        Recorder recorder;
        edit(recorder, layer, old, added);
        EXPECT_TRUE(recorder.finish().undo(isShared).empty());
        const auto took = double(std::clock() - start);
        EXPECT_TRUE(textOf(layer) == before);  // Not EXPECT_EQ, which would print both.
        return took;
    };
    for (const auto& [kind, edit] : kinds)
        for (const auto& isShared : {Record::IsShared(kShared), Record::IsShared(kMine)}) {
            double ratio = 1000;  // the best of some, because the machine may be busy
            for (int i = 0; i < 5 && ratio > 15; ++i)
                ratio = std::min(ratio, cost(edit, isShared, 4'000) / cost(edit, isShared, 500));
            EXPECT_LT(ratio, 15) << kind;  // for 8 times as many
        }
}

// Two authors edit, one after the other; the first undoes. Registers that the second wrote keep
// these values, and the others have their previous values.
TEST(Recorder, AnUndoNeverWritesARegisterThatSomebodyElseWroteSince) {
    for (unsigned seed = 0; seed < 100; ++seed) {
        SCOPED_TRACE(seed);
        std::mt19937 random(seed);
        const auto layer = pxr::SdfLayer::CreateAnonymous(".usda");
        std::map<SdfPath, double> expected;
        std::set<SdfPath> mine, theirs;
        for (const char* prim : {"/A", "/B", "/C"})
            for (const char* name : {"x", "y", "z"}) {
                const SdfPath path = SdfPath(prim).AppendProperty(TfToken(name));
                setDefault(layer, path, 0);
                expected[path] = 0;
            }
        const auto any = [&] { return std::next(expected.begin(), int(random() % 9))->first; };

        Recorder recorder;
        recorder.touch(layer, SdfPath::AbsoluteRootPath(), true);
        for (int i = 0; i < 4; ++i) setDefault(layer, *mine.insert(any()).first, 1);
        const Record record = recorder.finish();
        for (int i = 0; i < 4; ++i) {
            const SdfPath path = any();
            theirs.insert(path);
            setDefault(layer, path, expected[path] = 2 + i);
        }
        std::set<SdfPath> kept;
        for (const Kept& one : record.undo(kShared)) kept.insert(one.path);
        for (const auto& [path, number] : expected)
            EXPECT_EQ(layer->GetField(path, kDefault), VtValue(number)) << path;
        std::set<SdfPath> both;
        std::ranges::set_intersection(mine, theirs, std::inserter(both, both.end()));
        EXPECT_EQ(kept, both);
    }
}

TEST_F(RecorderTest, NothingWrittenIsAnEmptyRecord) {
    EXPECT_TRUE(recorder.finish().isEmpty());
    EXPECT_TRUE(Record().isEmpty());
    setDefault(layer, x, 1);
    EXPECT_TRUE(recorder.finish().isEmpty()) << "finish() starts a new record";
}

TEST_F(RecorderTest, ASampleOfSomebodyElseIsKept) {
    layer->SetTimeSample(x, 1, 5.0);
    layer->SetTimeSample(x, 2, 6.0);
    const Record record = recorder.finish();
    layer->SetTimeSample(x, 2, 7.0);
    const auto kept = record.undo(kShared);
    ASSERT_EQ(kept.size(), 1U);
    EXPECT_EQ(kept[0].path, x);
    EXPECT_EQ(kept[0].field, "timeSamples");
    EXPECT_EQ(kept[0].part, Part(2.0));
    EXPECT_EQ(layer->ListTimeSamplesForPath(x), std::set<double>{2});
}

TEST_F(RecorderTest, OtherKeysAndItemsOfOneFieldAreKept) {
    setKey("mine", 1);
    setKey("deep:mine", 1);
    prepend(layer, prim, "/Mine");
    layer->GetPrimAtPath(prim)->GetReferenceList().Remove(pxr::SdfReference("", SdfPath("/Old")));
    layer->SetSubLayerPaths({"./mine.usda"});
    const Record record = recorder.finish();
    setKey("theirs", 2);
    setKey("deep:theirs", 2);
    prepend(layer, prim, "/Theirs");
    layer->InsertSubLayerPath("./theirs.usda");
    EXPECT_TRUE(record.undo(kShared).empty());
    EXPECT_EQ(key("mine"), -1);
    EXPECT_EQ(key("deep:mine"), -1);
    EXPECT_EQ(key("theirs"), 2);
    EXPECT_EQ(key("deep:theirs"), 2);
    const auto references = value(prim, kReferences).Get<pxr::SdfReferenceListOp>();
    EXPECT_EQ(references.GetPrependedItems().size(), 2U);
    EXPECT_TRUE(references.HasItem(pxr::SdfReference("", SdfPath("/Old"))));
    EXPECT_TRUE(references.HasItem(pxr::SdfReference("", SdfPath("/Theirs"))));
    EXPECT_TRUE(references.GetDeletedItems().empty());
    EXPECT_EQ(std::vector<std::string>(layer->GetSubLayerPaths()),
              (std::vector<std::string>{"./old.usda", "./theirs.usda"}));
}

TEST_F(RecorderTest, ACreatedPrimThatSomebodyElseFilledStays) {
    define(layer, SdfPath("/New/Mine"));
    define(layer, SdfPath("/Alone"));
    const Record record = recorder.finish();
    define(layer, SdfPath("/New/Theirs"));
    const auto kept = record.undo(kShared);
    ASSERT_EQ(kept.size(), 1U);
    EXPECT_EQ(kept[0].path, SdfPath("/New"));
    EXPECT_TRUE(kept[0].field.IsEmpty());
    EXPECT_TRUE(layer->GetPrimAtPath(SdfPath("/New/Theirs")));
    EXPECT_FALSE(layer->GetPrimAtPath(SdfPath("/New/Mine")));
    EXPECT_FALSE(layer->GetPrimAtPath(SdfPath("/Alone")));
    record.undo(kMine);
    EXPECT_FALSE(layer->GetPrimAtPath(SdfPath("/New"))) << "whatever others wrote";
}

TEST_F(RecorderTest, ADeletedPrimThatSomebodyElseCreatedAgainStays) {
    removeSpec(layer, prim);
    const Record record = recorder.finish();
    define(layer, prim)->SetTypeName("Sphere");
    const auto kept = record.undo(kShared);
    ASSERT_EQ(kept.size(), 1U);
    EXPECT_EQ(kept[0].path, prim);
    EXPECT_EQ(layer->GetPrimAtPath(prim)->GetTypeName(), "Sphere");
    EXPECT_FALSE(layer->GetAttributeAtPath(x));
}

TEST_F(RecorderTest, SpecsThatSomebodyElseDeletedStayDeleted) {
    setDefault(layer, x, 1);
    const Record record = recorder.finish();
    removeSpec(layer, prim);
    const auto kept = record.undo(kShared);
    ASSERT_EQ(kept.size(), 1U);
    EXPECT_NE(kept[0].reason.find("no longer there"), std::string::npos);
    EXPECT_FALSE(layer->GetPrimAtPath(prim));
}

TEST(Recorder, TouchingTheMissingAncestorsIsEnoughToRemoveThem) {
    const auto layer = pxr::SdfLayer::CreateAnonymous(".usda");
    define(layer, SdfPath("/A"));
    Recorder recorder;
    recorder.touchWithAncestors(layer, SdfPath("/A/B/C"));
    define(layer, SdfPath("/A/B/C"));
    define(layer, SdfPath("/Other"));
    EXPECT_TRUE(recorder.finish().undo(kShared).empty());
    EXPECT_FALSE(layer->GetPrimAtPath(SdfPath("/A/B")));
    EXPECT_TRUE(layer->GetPrimAtPath(SdfPath("/A")));
    EXPECT_TRUE(layer->GetPrimAtPath(SdfPath("/Other"))) << "was not touched";
}

TEST(LayerEdits, ALayerIsMadeLikeAnother) {
    for (unsigned seed = 0; seed < 100; ++seed) {
        SCOPED_TRACE(seed);
        std::mt19937 random(seed);
        const auto layer = randomLayer(random), wanted = randomLayer(random);
        makeLike(layer, wanted);
        std::vector<SdfPath> have = pathsBelow(layer, SdfPath::AbsoluteRootPath());
        std::vector<SdfPath> want = pathsBelow(wanted, SdfPath::AbsoluteRootPath());
        for (const SdfPath& path : want) {
            EXPECT_TRUE(
                changesBetween(path, readFields(layer, path), readFields(wanted, path)).empty())
                << path;
            EXPECT_EQ(primChildren(layer, path), primChildren(wanted, path)) << path;
        }
        std::ranges::sort(have);
        std::ranges::sort(want);
        EXPECT_EQ(have, want);
    }
}

TEST(LayerEdits, ChildrenAreArrangedAsIfTheyWereMovedOneByOne) {
    for (unsigned seed = 0; seed < 1'000; ++seed) {
        SCOPED_TRACE(seed);
        std::mt19937 random(seed);
        const auto some = [&] {
            pxr::TfTokenVector names;
            for (char name = 'a'; name < 'i'; ++name)
                if (random() % 4 != 0) names.emplace_back(std::string(1, name));
            std::ranges::shuffle(names, random);
            return names;
        };
        const auto children = some(), order = some(), moving = some();
        auto expected = children;
        auto next = 0;  // after all visited ones
        for (const TfToken& name : order) {
            auto place = int(std::ranges::find(expected, name) - expected.begin());
            if (place == int(expected.size())) continue;
            if (std::ranges::find(moving, name) != moving.end()) {
                expected.erase(expected.begin() + place);
                if (place < next) --next;
                place = next;
                expected.insert(expected.begin() + place, name);
            }
            next = std::max(next, place + 1);
        }
        EXPECT_EQ(arranged(children, order, {moving.begin(), moving.end()}), expected);
    }
}

TEST(LayerEdits, PathsWithinTheLayerFollowAMove) {
    const auto layer = pxr::SdfLayer::CreateAnonymous(".usda");
    const auto prim = define(layer, SdfPath("/A"));
    pxr::SdfRelationshipSpec::New(prim, "r", false)
        ->GetTargetPathList()
        .Prepend(SdfPath("/Old/Child"));
    prepend(layer, SdfPath("/A"), "/Old");
    prim->GetReferenceList().Prepend(pxr::SdfReference("./other.usda", SdfPath("/Old")));
    retarget(layer, {{SdfPath("/Old"), SdfPath("/New")}});
    const auto references = layer->GetFieldAs<pxr::SdfReferenceListOp>(SdfPath("/A"), kReferences);
    EXPECT_TRUE(references.HasItem(pxr::SdfReference("", SdfPath("/New"))));
    EXPECT_TRUE(references.HasItem(pxr::SdfReference("./other.usda", SdfPath("/Old"))));
    EXPECT_TRUE(layer->GetFieldAs<pxr::SdfPathListOp>(SdfPath("/A.r"), TfToken("targetPaths"))
                    .HasItem(SdfPath("/New/Child")));
}

}  // namespace usdlive::content
