// Tests that two lines of history become one: what only one has changed is there, and conflicts are
// found.
#include "session/LineMerge.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <map>
#include <set>

#include "unit/common/history/RandomHistory.h"

using namespace usdlive;
using namespace usdlive::client;

namespace {

const Side kSides[] = {Side::Into, Side::From};
constexpr std::int32_t kOld = 1, kNew = 2, kMain = 3;

struct Ended {
    LayerDoc content;
    LineMerge::Merged merged;
};

/// Merges, and applies the edits to the other line.
Ended ended(const LineMerge& merge, Side side) {
    auto merged = merge.merge([&](const MergeConflict& conflict) {
        return conflict.what == MergeConflict::What::Refused ? Side::Into : side;
    });
    EXPECT_TRUE(merged) << merged.error().message;
    Ended result;
    result.content = merge.into().at(kLayer);
    if (!merged) return result;
    for (const AuthoredEdit& edit : merged->edits) {
        const auto applied = result.content.apply(edit.path, edit.action, LayerDoc::By::Author);
        EXPECT_TRUE(applied) << edit.path << ": " << applied.error().message;
    }
    result.merged = *std::move(merged);
    return result;
}

// A composite field without parts. The executor writes fields by their parts, so that it is not
// there.
bool isEmpty(const FieldValue& field) {
    if (const auto* list = field.as<ListOp>())
        return !list->isExplicit &&
               std::ranges::all_of(list->lists, [](const ListItems& one) { return one.empty(); });
    const auto* map = field.as<Map>();
    return map && map->entries.empty();
}
bool hasEmptyFields(const LayerDoc& doc) {
    bool has = false;
    doc.visit([&](const LayerDoc::SpecView& spec) {
        for (const auto& [name, field] : *spec.fields) has = has || isEmpty(field);
    });
    return has;
}

LineMerge lines(const RandomHistory& from, const std::vector<Commit>& into) {
    LineMerge merge({{kLayer, from.docs.front()}}, 0);
    for (const Commit& commit : from.commits) EXPECT_TRUE(merge.addFrom(commit));
    for (const Commit& commit : into) EXPECT_TRUE(merge.addInto(commit));
    return merge;
}

// A history that begins as another one does, and then goes its own way.
std::vector<Commit> other(const RandomHistory& history, unsigned seed, int count) {
    RandomEdits random(seed + 10'000);
    LayerDoc doc = history.docs.front();
    std::vector<Commit> commits;
    while (int(commits.size()) < count) {
        Commit commit;
        commit.revision = commits.size() + 1;
        commit.user = UserName{"dee"};
        commit.id.client = ClientId{"dee"};
        while (commit.edits.empty()) {
            auto [path, action] = random.edit(doc);
            if (random.chance(2))
                std::tie(path, action) =
                    std::pair(random.of(RandomEdits::paths(doc)), random.fieldEdit());
            const auto applied = doc.apply(path, action);
            if (applied && applied->changed)
                commit.edits.push_back({kLayer, {path, {}}, action, {}});
        }
        commits.push_back(std::move(commit));
    }
    return commits;
}

using Fields = std::map<std::string, FieldValue>;
std::map<NodeId, Fields> fieldsOf(const LayerDoc& doc) {
    std::map<NodeId, Fields> all;
    doc.visit([&](const LayerDoc::SpecView& spec) {
        all[spec.node] = Fields(spec.fields->begin(), spec.fields->end());
    });
    return all;
}

Commit commitOf(Revision revision, std::vector<std::pair<std::string, EditAction>> edits) {
    Commit commit;
    commit.revision = revision;
    commit.user = UserName{"ann"};
    for (auto& [path, action] : edits) commit.edits.push_back({kLayer, {path, {}}, action, {}});
    return commit;
}

LayerDoc scene() {
    LayerDoc doc;
    for (const char* path : {"/World", "/World/Ball", "/World/Ball/Dot", "/World/Gone"})
        EXPECT_TRUE(doc.apply(path, CreateSpec{}));
    EXPECT_TRUE(doc.apply("/World/Ball", setInt("number", kOld)));
    return doc;
}

EditAction named(const std::string& name) { return MoveSpec{{"/World", {}}, name}; }

FieldValue numberIn(const LayerDoc& doc, const std::string& path) {
    const FieldValue* const field = doc.field(path, "number");
    return field ? *field : FieldValue();
}
FieldValue holding(std::int32_t number) { return intValue(number); }

}  // namespace

TEST(LineMergeProperty, AloneALineIsTheResult) {
    for (unsigned seed = 1; seed <= seedsOf(300); ++seed) {
        SCOPED_TRACE(seed);
        const RandomHistory history(seed, 12);
        const LayerDoc& last = history.docs.back();
        if (hasEmptyFields(last) || hasRepeatedItems(last)) continue;
        const auto result = ended(lines(history, {}), Side::Undecided);
        ASSERT_EQ(result.content.dump(), history.docs.back().dump());
        ASSERT_TRUE(result.merged.conflicts.empty());
        ASSERT_EQ(result.merged.dropped, 0u);
    }
}

TEST(LineMergeProperty, ALineWithoutChangesChangesNothing) {
    for (unsigned seed = 1; seed <= seedsOf(100); ++seed) {
        SCOPED_TRACE(seed);
        const RandomHistory history(seed, 0);
        const auto result = ended(lines(history, other(history, seed, 10)), Side::From);
        ASSERT_TRUE(result.merged.edits.empty());
        ASSERT_TRUE(result.merged.conflicts.empty());
    }
}

// A field that only one line has changed has its content. Where both have, the chosen one counts.
TEST(LineMergeProperty, EachFieldHasTheContentOfTheLineThatChangedIt) {
    std::size_t compared = 0, conflicts = 0, impossible = 0;
    for (unsigned seed = 1; seed <= seedsOf(400); ++seed) {
        const RandomHistory history(seed, 10);
        if (std::ranges::any_of(history.docs, hasRepeatedItems)) continue;
        for (const Side side : kSides) {
            SCOPED_TRACE(std::to_string(seed) + (side == Side::From ? " from" : " into"));
            const LineMerge merge = lines(history, other(history, seed, 10));
            // A deleted spec cannot come back where another one is by now.
            const auto asked = merge.merge([&](const MergeConflict& conflict) {
                return conflict.what == MergeConflict::What::Refused ? Side::Into : side;
            });
            if (!asked && side == Side::From && asked.error().code == ErrorCode::InvalidArgument) {
                ++impossible;
                continue;
            }
            const auto result = ended(merge, side);
            ASSERT_FALSE(HasFailure());
            std::set<std::pair<std::string, std::string>> inConflict;
            for (const MergeConflict& one : result.merged.conflicts)
                inConflict.emplace(one.path, one.field);
            conflicts += result.merged.conflicts.size();
            const auto before = fieldsOf(history.docs.front());
            const auto from = fieldsOf(history.docs.back());
            const auto into = fieldsOf(merge.into().at(kLayer));
            const auto after = fieldsOf(result.content);
            const auto at = [](const Fields& fields, const std::string& name) {
                const auto found = fields.find(name);
                return found == fields.end() ? std::nullopt : std::optional(found->second);
            };
            for (const auto& [node, fields] : before) {
                if (!from.contains(node) || !into.contains(node) || !after.contains(node)) continue;
                std::set<std::string> names;
                for (const auto* one : {&fields, &from.at(node), &into.at(node)})
                    for (const auto& [name, value] : *one) names.insert(name);
                for (const std::string& name : names) {
                    const auto was = at(fields, name), inFrom = at(from.at(node), name),
                               inInto = at(into.at(node), name), is = at(after.at(node), name);
                    const auto hasNothing = [](const auto& one) { return one && isEmpty(*one); };
                    if (hasNothing(was) || hasNothing(inFrom) || hasNothing(inInto)) continue;
                    ++compared;
                    if (inFrom == was) {
                        ASSERT_EQ(is, inInto) << node << " " << name;
                    } else if (inInto == was) {
                        ASSERT_EQ(is, inFrom) << node << " " << name;
                    }
                }
            }
        }
    }
    EXPECT_GT(compared, seedsOf(400) * 10);
    EXPECT_GT(conflicts, seedsOf(400) / 4);
    EXPECT_LT(impossible, seedsOf(400) / 5);
}

TEST(LineMerge, FollowsARenameOfTheOtherLine) {
    LineMerge merge({{kLayer, scene()}}, 4);
    ASSERT_TRUE(merge.addFrom(commitOf(
        5, {{"/World/Ball/Dot", setInt("number", kNew)}, {"/World/Ball/Extra", CreateSpec{}}})));
    ASSERT_TRUE(merge.addInto(commitOf(5, {{"/World/Ball", named("Globe")}})));
    const auto result = ended(merge, Side::Undecided);
    EXPECT_TRUE(result.merged.conflicts.empty());
    EXPECT_EQ(numberIn(result.content, "/World/Globe/Dot"), holding(kNew));
    EXPECT_TRUE(result.content.has("/World/Globe/Extra"));
    EXPECT_FALSE(result.content.has("/World/Ball"));
}

TEST(LineMerge, FindsARegisterThatBothHaveChanged) {
    LineMerge merge({{kLayer, scene()}}, 4);
    ASSERT_TRUE(merge.addFrom(commitOf(5, {{"/World/Ball", setInt("number", kNew)}})));
    ASSERT_TRUE(merge.addInto(commitOf(5, {{"/World/Ball", setInt("number", kMain)}})));
    for (const Side side : kSides) {
        const auto result = ended(merge, side);
        ASSERT_EQ(result.merged.conflicts.size(), 1u);
        const MergeConflict& found = result.merged.conflicts.front();
        EXPECT_EQ(found.path, "/World/Ball");
        EXPECT_EQ(found.field, "number");
        EXPECT_EQ(found.intoUser, UserName{"ann"});
        EXPECT_EQ(found.before, holding(kOld));
        EXPECT_EQ(numberIn(result.content, "/World/Ball"),
                  holding(side == Side::From ? kNew : kMain));
    }
}

TEST(LineMerge, TheSameChangeIsNoConflict) {
    LineMerge merge({{kLayer, scene()}}, 4);
    ASSERT_TRUE(merge.addFrom(commitOf(5, {{"/World/Ball", setInt("number", kNew)}})));
    ASSERT_TRUE(merge.addInto(commitOf(5, {{"/World/Ball", setInt("number", kNew)}})));
    EXPECT_TRUE(ended(merge, Side::Undecided).merged.conflicts.empty());
}

// A spec that one line has deleted and the other changed is kept or deleted as a whole.
TEST(LineMerge, ASpecThatOneLineHasDeleted) {
    LineMerge merge({{kLayer, scene()}}, 4);
    ASSERT_TRUE(merge.addFrom(commitOf(5, {{"/World/Ball/Dot", setInt("number", kNew)},
                                           {"/World/Ball", setInt("number", kNew)}})));
    ASSERT_TRUE(merge.addInto(commitOf(5, {{"/World/Ball", DeleteSpec{}}})));
    const auto main = ended(merge, Side::Into);
    ASSERT_EQ(main.merged.conflicts.size(), 1u) << "one for the whole spec";
    EXPECT_EQ(main.merged.conflicts.front().what, MergeConflict::What::Deleted);
    EXPECT_FALSE(main.merged.conflicts.front().isDeletedFrom);
    EXPECT_FALSE(main.content.has("/World/Ball"));
    const auto session = ended(merge, Side::From);
    EXPECT_EQ(numberIn(session.content, "/World/Ball/Dot"), holding(kNew));
}

TEST(LineMerge, ANewSpecBelowOneThatTheOtherLineHasDeleted) {
    LineMerge merge({{kLayer, scene()}}, 4);
    ASSERT_TRUE(merge.addFrom(commitOf(5, {{"/World/Ball/Extra", CreateSpec{}}})));
    ASSERT_TRUE(merge.addInto(commitOf(5, {{"/World/Ball", DeleteSpec{}}})));
    const auto main = ended(merge, Side::Into);
    ASSERT_EQ(main.merged.conflicts.size(), 1u) << "nothing is lost without a decision";
    EXPECT_EQ(main.merged.conflicts.front().path, "/World/Ball");
    EXPECT_TRUE(main.merged.edits.empty());
    EXPECT_EQ(main.merged.dropped, 0u);
    EXPECT_TRUE(ended(merge, Side::From).content.has("/World/Ball/Extra"));
}

TEST(LineMerge, ASpecMovedOutOfOneThatTheOtherLineHasDeleted) {
    LineMerge merge({{kLayer, scene()}}, 4);
    ASSERT_TRUE(merge.addFrom(commitOf(5, {{"/World/Ball/Dot", named("Dot")}})));
    ASSERT_TRUE(merge.addInto(commitOf(5, {{"/World/Ball", DeleteSpec{}}})));
    const auto session = ended(merge, Side::From);
    EXPECT_TRUE(session.content.has("/World/Dot")) << session.content.dump();
    EXPECT_FALSE(session.content.has("/World/Ball"));
    EXPECT_FALSE(ended(merge, Side::Into).content.has("/World/Dot"));
}

TEST(LineMerge, ASpecMovedIntoOneThatTheOtherLineHasDeleted) {
    LineMerge merge({{kLayer, scene()}}, 4);
    ASSERT_TRUE(merge.addFrom(commitOf(5, {{"/World/Gone", MoveSpec{{"/World/Ball", {}}, "Kept"}},
                                           {"/World/Ball/Kept", setInt("number", kNew)}})));
    ASSERT_TRUE(merge.addInto(commitOf(5, {{"/World/Ball", DeleteSpec{}}})));
    const auto main = ended(merge, Side::Into);
    ASSERT_EQ(main.merged.conflicts.size(), 1u);
    EXPECT_EQ(main.merged.conflicts.front().what, MergeConflict::What::Refused);
    EXPECT_EQ(numberIn(main.content, "/World/Gone"), holding(kNew)) << "it stays where it was";
}

TEST(LineMerge, TheSameRenameIsNoConflict) {
    LineMerge merge({{kLayer, scene()}}, 4);
    ASSERT_TRUE(merge.addFrom(commitOf(5, {{"/World/Ball", named("Sun")}})));
    ASSERT_TRUE(merge.addInto(commitOf(5, {{"/World/Ball", named("Sun")}})));
    const auto result = ended(merge, Side::Undecided);
    EXPECT_TRUE(result.merged.conflicts.empty());
    EXPECT_TRUE(result.content.has("/World/Sun"));
}

TEST(LineMerge, ASpecThatTheMergedLineHasDeleted) {
    LineMerge merge({{kLayer, scene()}}, 4);
    ASSERT_TRUE(
        merge.addFrom(commitOf(5, {{"/World/Ball", DeleteSpec{}}, {"/World/Gone", DeleteSpec{}}})));
    ASSERT_TRUE(merge.addInto(commitOf(5, {{"/World/Ball/Dot", setInt("number", kMain)}})));
    const auto main = ended(merge, Side::Into);
    ASSERT_EQ(main.merged.conflicts.size(), 1u);
    EXPECT_TRUE(main.merged.conflicts.front().isDeletedFrom);
    EXPECT_EQ(numberIn(main.content, "/World/Ball/Dot"), holding(kMain));
    EXPECT_FALSE(main.content.has("/World/Gone")) << "nobody else has changed it";
    EXPECT_FALSE(ended(merge, Side::From).content.has("/World/Ball"));
}

TEST(LineMerge, APlaceThatTheOtherLineHasTaken) {
    LineMerge merge({{kLayer, scene()}}, 4);
    ASSERT_TRUE(merge.addFrom(
        commitOf(5, {{"/World/Ball", named("Sun")}, {"/World/Sun", setInt("number", kNew)}})));
    ASSERT_TRUE(merge.addInto(commitOf(5, {{"/World/Sun", CreateSpec{}}})));
    auto merged = merge.merge([](const MergeConflict& conflict) {
        EXPECT_EQ(conflict.what, MergeConflict::What::Refused);
        return Side::From;
    });
    ASSERT_FALSE(merged);
    EXPECT_EQ(merged.error().code, ErrorCode::InvalidArgument);
    const auto result = ended(merge, Side::Into);
    ASSERT_EQ(result.merged.conflicts.size(), 1u);
    EXPECT_EQ(numberIn(result.content, "/World/Ball"), holding(kNew)) << "it keeps its name";
    EXPECT_TRUE(result.content.has("/World/Sun"));
}

TEST(LineMerge, APlaceToWhichTheOtherLineHasMovedASpecOfARenamedParent) {
    LineMerge merge({{kLayer, scene()}}, 4);
    ASSERT_TRUE(merge.addFrom(commitOf(5, {{"/World", MoveSpec{{"/", {}}, "Set"}},
                                           {"/Prop", CreateSpec{}},
                                           {"/Prop", setInt("number", kNew)}})));
    ASSERT_TRUE(merge.addInto(commitOf(5, {{"/World/Ball", MoveSpec{{"/", {}}, "Prop"}}})));
    const auto result = ended(merge, Side::From);
    ASSERT_EQ(result.merged.conflicts.size(), 1u);
    EXPECT_EQ(result.merged.conflicts.front().what, MergeConflict::What::Refused);
    EXPECT_EQ(numberIn(result.content, "/Prop"), holding(kOld)) << result.content.dump();
    EXPECT_TRUE(result.content.has("/Set"));
}

TEST(LineMerge, ASpecThatBothHaveRenamed) {
    LineMerge merge({{kLayer, scene()}}, 4);
    ASSERT_TRUE(merge.addFrom(
        commitOf(5, {{"/World/Ball", named("Sun")}, {"/World/Sun", setInt("number", kNew)}})));
    ASSERT_TRUE(merge.addInto(commitOf(5, {{"/World/Ball", named("Moon")}})));
    for (const Side side : kSides) {
        const auto result = ended(merge, side);
        ASSERT_EQ(result.merged.conflicts.size(), 1u);
        EXPECT_EQ(result.merged.conflicts.front().what, MergeConflict::What::Moved);
        const std::string name = side == Side::From ? "/World/Sun" : "/World/Moon";
        EXPECT_EQ(numberIn(result.content, name), holding(kNew)) << result.content.dump();
    }
}

TEST(LineMerge, ASpecThatBothHaveMovedIntoNewOnes) {
    const auto moved = [](const char* parent) {
        const std::string path = std::string("/World/") + parent;
        return commitOf(
            5, {{path, CreateSpec{SpecKind::Prim}}, {"/World/Ball", MoveSpec{{path, {}}, "Ball"}}});
    };
    for (const char* other : {"Box", "Bag"}) {
        LineMerge merge({{kLayer, scene()}}, 4);
        ASSERT_TRUE(merge.addFrom(moved("Bag")));
        ASSERT_TRUE(merge.addInto(moved(other)));
        const auto result = ended(merge, Side::From);
        const std::size_t expected = other == std::string("Bag") ? 0 : 1;
        EXPECT_EQ(result.merged.conflicts.size(), expected) << other;
        EXPECT_TRUE(result.content.has("/World/Bag/Ball")) << result.content.dump();
    }
}

TEST(LineMerge, ANewSpecWhereOneStaysThatBothHaveMoved) {
    LineMerge merge({{kLayer, scene()}}, 4);
    ASSERT_TRUE(merge.addFrom(commitOf(5, {{"/World/Ball", named("Sun")},
                                           {"/World/Moon", CreateSpec{}},
                                           {"/World/Moon", setInt("number", kNew)}})));
    ASSERT_TRUE(merge.addInto(commitOf(5, {{"/World/Ball", named("Moon")}})));
    const auto main = ended(merge, Side::Into);
    EXPECT_EQ(main.merged.conflicts.size(), 2u);
    EXPECT_EQ(numberIn(main.content, "/World/Moon"), holding(kOld)) << main.content.dump();
    const auto session = ended(merge, Side::From);
    EXPECT_EQ(session.merged.conflicts.size(), 1u);
    EXPECT_EQ(numberIn(session.content, "/World/Sun"), holding(kOld)) << session.content.dump();
    EXPECT_EQ(numberIn(session.content, "/World/Moon"), holding(kNew));
}

// ---- lines that are merged several times, in both directions

namespace {

// Two lines with everything that they have received from each other.
class TwoLines {
public:
    struct Line {
        LayerDoc doc;
        std::vector<Commit> commits;

        bool edit(const std::string& path, const EditAction& action, const char* user) {
            const auto applied = doc.apply(path, action, LayerDoc::By::Author);
            if (!applied || !applied->changed) return false;
            append({{kLayer, {path, {}}, action, {}}}, user);
            return true;
        }
        void append(std::vector<Edit> edits, const char* user) {
            Commit commit;
            commit.revision = commits.size() + 1;
            commit.user = UserName{user};
            commit.id.client = ClientId{user};
            commit.edits = std::move(edits);
            commits.push_back(std::move(commit));
        }
    };

    explicit TwoLines(const LayerDoc& start) : main{start, {}}, session{start, {}}, start_(start) {}

    // Returns what a merge into a line is made of.
    [[nodiscard]] LineMerge merge(const Line& into) const {
        const Line& from = &into == &main ? session : main;
        LineMerge merge({{kLayer, start_}}, 0);
        std::size_t fromAt = 0, intoAt = 0;
        const auto goTo = [&](std::size_t fromEnd, std::size_t intoEnd) {
            for (; fromAt < fromEnd; ++fromAt) EXPECT_TRUE(merge.addFrom(from.commits[fromAt]));
            for (; intoAt < intoEnd; ++intoAt) EXPECT_TRUE(merge.addInto(into.commits[intoAt]));
        };
        for (const auto& [isMain, given, received] : received_) {
            const bool isInto = isMain == (&into == &main);
            goTo(isInto ? given : received, isInto ? received : given);
            const auto done = merge.received(isInto ? Side::Into : Side::From);
            EXPECT_TRUE(done) << done.error().message;
        }
        goTo(from.commits.size(), into.commits.size());
        return merge;
    }

    // Brings the other line's changes to a line.
    LineMerge::Merged bring(Line& into, Side side) {
        const LineMerge merging = merge(into);
        EXPECT_EQ(merging.into().at(kLayer).dump(), into.doc.dump());
        const auto decided = [&](Side counts) {
            return merging.merge([counts](const MergeConflict& conflict) {
                return conflict.what == MergeConflict::What::Refused ? Side::Into : counts;
            });
        };
        auto merged = decided(side);
        // A deleted spec cannot come back where another one is by now.
        if (!merged && side == Side::From && merged.error().code == ErrorCode::InvalidArgument)
            merged = decided(Side::Into);
        EXPECT_TRUE(merged) << merged.error().message;
        if (!merged) return {};
        std::vector<Edit> edits;
        for (const AuthoredEdit& edit : merged->edits) {
            const auto applied = into.doc.apply(edit.path, edit.action, LayerDoc::By::Author);
            EXPECT_TRUE(applied) << edit.path << ": " << applied.error().message;
            edits.push_back({kLayer, {edit.path, {}}, edit.action, {}});
        }
        if (!edits.empty()) into.append(std::move(edits), "merger");
        const Line& from = &into == &main ? session : main;
        received_.push_back({&into == &main, from.commits.size(), into.commits.size()});
        return *std::move(merged);
    }

    Line main, session;

private:
    struct Received {
        bool isMain;  // the line that has received
        std::size_t given, received;
    };
    const LayerDoc start_;
    std::vector<Received> received_;
};

Side anySide(RandomEdits& random) { return kSides[random.below(2)]; }

}  // namespace

// An update and then a merge make both alike, whatever they have done and merged before.
TEST(LineMergeProperty, LinesThatHaveReceivedEverythingAreAlike) {
    std::size_t compared = 0, conflicts = 0;
    for (unsigned seed = 1; seed <= seedsOf(600); ++seed) {
        SCOPED_TRACE(seed);
        RandomEdits random(seed);
        TwoLines lines(RandomHistory(seed, 0).docs.front());
        const auto isOdd = [&] {
            return std::ranges::any_of(
                std::array{&lines.main.doc, &lines.session.doc},
                [](const LayerDoc* doc) { return hasEmptyFields(*doc) || hasRepeatedItems(*doc); });
        };
        bool wasOdd = isOdd();
        for (int step = 0; step < 40 && !wasOdd; ++step) {
            TwoLines::Line& line = random.chance(2) ? lines.main : lines.session;
            if (random.chance(8)) {
                conflicts += lines.bring(line, anySide(random)).conflicts.size();
                ASSERT_FALSE(HasFailure());
            } else {
                auto [path, action] = random.edit(line.doc);
                line.edit(path, action, &line == &lines.main ? "ann" : "bo");
            }
            wasOdd = isOdd();
        }
        if (wasOdd) continue;
        (void)lines.bring(lines.session, anySide(random));
        const auto merged = lines.bring(lines.main, Side::Undecided);
        ASSERT_FALSE(HasFailure());
        ASSERT_TRUE(merged.conflicts.empty());
        ASSERT_EQ(lines.main.doc.dump(), lines.session.doc.dump());
        for (TwoLines::Line* line : {&lines.main, &lines.session}) {
            const auto again = lines.bring(*line, Side::Undecided);
            ASSERT_TRUE(again.edits.empty() && again.conflicts.empty());
        }
        ++compared;
    }
    EXPECT_GT(compared, seedsOf(600) / 3);
    EXPECT_GT(conflicts, seedsOf(600) / 2);
}

// Each line has registers and prims of its own, and both rename what both have. In the end both
// lines have the last content of each register, and each prim once.
TEST(LineMergeProperty, NoEditIsLostOrDoubled) {
    constexpr std::size_t kPrims = 4;
    for (unsigned seed = 1; seed <= seedsOf(300); ++seed) {
        SCOPED_TRACE(seed);
        RandomEdits random(seed);
        LayerDoc start;
        ASSERT_TRUE(start.apply("/W", CreateSpec{}));
        for (std::size_t prim = 0; prim < kPrims; ++prim) {
            const std::string path = "/W/p" + std::to_string(prim);
            ASSERT_TRUE(start.apply(path, CreateSpec{}));
            ASSERT_TRUE(start.apply(path, setInt("name", std::int32_t(prim))));
        }
        TwoLines lines(start);
        std::map<std::int32_t, std::map<std::string, std::int32_t>> wanted;  // by "name"
        std::int32_t next = 100;
        const auto nameIn = [](const LayerDoc& doc, const std::string& path) {
            const FieldValue* const field = doc.field(path, "name");
            return field ? std::optional(*field) : std::nullopt;
        };
        const auto primsIn = [&](const LayerDoc& doc) {
            std::vector<std::string> all = RandomEdits::paths(doc);
            std::erase_if(all, [&](const std::string& path) { return !nameIn(doc, path); });
            return all;
        };
        const auto numberOf = [&](const LayerDoc& doc, const std::string& path) {
            for (std::int32_t number = 0; number <= next; ++number)
                if (nameIn(doc, path) == FieldValue(intValue(number))) return number;
            return -1;
        };
        for (std::int32_t prim = 0; prim < std::int32_t(kPrims); ++prim) wanted[prim];
        for (int step = 0; step < 60; ++step) {
            const bool isMain = random.chance(2);
            TwoLines::Line& line = isMain ? lines.main : lines.session;
            const std::string path = random.of(primsIn(line.doc));
            switch (random.below(8)) {
                case 0:
                    (void)lines.bring(line, anySide(random));
                    break;
                case 1: {  // a name that nobody else uses
                    line.edit(path, MoveSpec{{"/W", {}}, "n" + std::to_string(++next)}, "ann");
                    break;
                }
                case 2: {
                    const std::int32_t number = ++next;
                    const std::string made = "/W/c" + std::to_string(number);
                    ASSERT_TRUE(line.edit(made, CreateSpec{}, "ann"));
                    ASSERT_TRUE(line.edit(made, setInt("name", number), "ann"));
                    wanted[number];
                    break;
                }
                default: {
                    const std::string field = isMain ? "ofMain" : "ofSession";
                    ASSERT_TRUE(line.edit(path, setInt(field, ++next), "ann"));
                    wanted[numberOf(line.doc, path)][field] = next;
                }
            }
            ASSERT_FALSE(HasFailure());
        }
        (void)lines.bring(lines.session, anySide(random));
        (void)lines.bring(lines.main, anySide(random));
        ASSERT_FALSE(HasFailure());
        for (const TwoLines::Line* line : {&lines.main, &lines.session}) {
            ASSERT_EQ(primsIn(line->doc).size(), wanted.size()) << line->doc.dump();
            for (const std::string& path : primsIn(line->doc))
                for (const auto& [field, number] : wanted.at(numberOf(line->doc, path))) {
                    const FieldValue* const held = line->doc.field(path, field);
                    ASSERT_TRUE(held && *held == holding(number)) << path << " " << field;
                }
        }
    }
}

// Later merges take nothing back that was brought, and find no conflict in it.
TEST(LineMerge, AMergeAfterAnUpdateBringsTheSessionsChangesOnly) {
    TwoLines lines(scene());
    ASSERT_TRUE(lines.session.edit("/World/Ball", setInt("number", kNew), "bo"));
    ASSERT_TRUE(lines.main.edit("/World/Gone", setInt("number", kMain), "ann"));
    ASSERT_EQ(lines.bring(lines.session, Side::Undecided).edits.size(), 1u);
    EXPECT_EQ(numberIn(lines.session.doc, "/World/Gone"), holding(kMain));
    const auto merged = lines.bring(lines.main, Side::Undecided);
    ASSERT_EQ(merged.edits.size(), 1u);
    EXPECT_EQ(merged.edits.front().path, "/World/Ball");
    ASSERT_TRUE(lines.main.edit("/World/Ball", setInt("number", kOld), "ann"));
    EXPECT_TRUE(lines.bring(lines.main, Side::From).edits.empty()) << "the session is unchanged";
    EXPECT_EQ(numberIn(lines.main.doc, "/World/Ball"), holding(kOld));
    ASSERT_TRUE(lines.bring(lines.session, Side::Undecided).conflicts.empty());
    EXPECT_EQ(numberIn(lines.session.doc, "/World/Ball"), holding(kOld));
}

TEST(LineMerge, ASpecThatWasMergedIsFollowedWhereItIsRenamed) {
    TwoLines lines(scene());
    ASSERT_TRUE(lines.main.edit("/World/Ball", named("Globe"), "ann"));
    ASSERT_TRUE(lines.session.edit("/World/New", CreateSpec{}, "bo"));
    (void)lines.bring(lines.main, Side::Undecided);
    ASSERT_TRUE(lines.main.edit("/World/New", named("Newer"), "ann"));
    ASSERT_TRUE(lines.session.edit("/World/New", setInt("number", kNew), "bo"));
    ASSERT_TRUE(lines.session.edit("/World/Ball/Dot", setInt("number", kNew), "bo"));
    const auto merged = lines.bring(lines.main, Side::Undecided);
    EXPECT_TRUE(merged.conflicts.empty());
    EXPECT_EQ(numberIn(lines.main.doc, "/World/Newer"), holding(kNew));
    EXPECT_EQ(numberIn(lines.main.doc, "/World/Globe/Dot"), holding(kNew));
    (void)lines.bring(lines.session, Side::Undecided);
    EXPECT_EQ(lines.main.doc.dump(), lines.session.doc.dump());
}

TEST(LineMerge, ADecisionIsNotAskedForAgain) {
    for (const Side side : kSides) {
        TwoLines lines(scene());
        ASSERT_TRUE(lines.session.edit("/World/Ball", setInt("number", kNew), "bo"));
        ASSERT_TRUE(lines.main.edit("/World/Ball", setInt("number", kMain), "ann"));
        ASSERT_EQ(lines.bring(lines.main, side).conflicts.size(), 1u);
        ASSERT_TRUE(lines.bring(lines.main, Side::Undecided).conflicts.empty());
        ASSERT_TRUE(lines.bring(lines.session, Side::Undecided).conflicts.empty());
        const auto both = holding(side == Side::From ? kNew : kMain);
        EXPECT_EQ(numberIn(lines.main.doc, "/World/Ball"), both);
        EXPECT_EQ(numberIn(lines.session.doc, "/World/Ball"), both);
    }
}

// A line that has read the layer from its file later than the other one began with changes of it.
TEST(LineMerge, ALayerThatTheLinesBeganToUseAtDifferentTimes) {
    LineMerge merge({{kLayer, scene()}}, 4);
    LayerDoc earlier;
    ASSERT_TRUE(earlier.apply("/World", CreateSpec{}));
    ASSERT_TRUE(earlier.apply("/World/Old", CreateSpec{}));
    ASSERT_TRUE(merge.setContent(Side::Into, kLayer, earlier));
    ASSERT_TRUE(merge.addInto(commitOf(5, {{"/World/Old", named("New")},
                                           {"/World/Ball", CreateSpec{}},
                                           {"/World/Ball", setInt("number", kMain)},
                                           {"/World/Gone2", CreateSpec{}}})));
    ASSERT_TRUE(merge.addFrom(
        commitOf(5, {{"/World/Ball", setInt("number", kNew)}, {"/World/Gone", named("Gone2")}})));
    ASSERT_TRUE(merge.matchContents());
    const auto result = ended(merge, Side::From);
    ASSERT_EQ(result.merged.conflicts.size(), 1u);
    EXPECT_EQ(result.merged.conflicts.front().what, MergeConflict::What::Value);
    EXPECT_EQ(result.merged.conflicts.front().intoUser, UserName{"ann"});
    EXPECT_EQ(numberIn(result.content, "/World/Ball"), holding(kNew));
    EXPECT_TRUE(result.content.has("/World/New"));
}
