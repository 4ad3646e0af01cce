// Tests that work of the past is taken back, and that the work of others stays.
#include "session/Reversal.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "unit/common/history/RandomHistory.h"

using namespace usdlive;
using namespace usdlive::client;

namespace {

struct Reverted {
    LayerDoc present, after;
    std::vector<KeptByUndo> kept;
    std::size_t edits = 0;
};

Reverted reverted(const RandomHistory& history, const std::function<bool(const Commit&)>& chosen) {
    Reversal reversal({{kLayer, history.docs.front()}});
    for (const Commit& commit : history.commits) {
        const bool isChosen = chosen(commit);
        const auto added = reversal.add(commit, [&](const Edit&) { return isChosen; });
        EXPECT_TRUE(added) << added.error().message;
    }
    EXPECT_EQ(reversal.layers().at(kLayer), history.docs.back());
    Reverted result;
    auto taken = reversal.takeBack();
    result.present = result.after = reversal.layers().at(kLayer);
    EXPECT_EQ(result.present, history.docs.back()) << "taking back changes the layers of no one";
    for (const AuthoredEdit& edit : taken.edits) {
        const auto applied = result.after.apply(edit.path, edit.action, LayerDoc::By::Author);
        EXPECT_TRUE(applied) << edit.path << ": " << applied.error().message;
    }
    result.kept = std::move(taken.kept);
    result.edits = taken.edits.size();
    return result;
}

}  // namespace

TEST(ReversalProperty, EverythingGoesBackExactly) {
    std::size_t edits = 0;
    for (unsigned seed = 1; seed <= seedsOf(400); ++seed) {
        SCOPED_TRACE(seed);
        const RandomHistory history(seed, 15);
        if (std::ranges::any_of(history.docs, hasRepeatedItems)) continue;
        const auto result = reverted(history, [](const Commit&) { return true; });
        ASSERT_EQ(result.after.dump(), history.docs.front().dump());
        ASSERT_TRUE(result.kept.empty());
        edits += result.edits;
    }
    EXPECT_GT(edits, seedsOf(400));
}

// The newest write of a register stays if it is not one of those that go back.
TEST(ReversalProperty, WhatOthersHaveWrittenLastStays) {
    std::size_t stayed = 0, kept = 0;
    for (unsigned seed = 1; seed <= seedsOf(400); ++seed) {
        SCOPED_TRACE(seed);
        const RandomHistory history(seed, 20);
        struct Write {
            NodeId node;
            std::string field;
            FieldPart part;
            bool isAnns, isSet = false;
        };
        std::vector<Write> writes;
        for (const Commit& commit : history.commits) {
            LayerDoc doc = history.docs[commit.revision - 1];
            for (const Edit& edit : commit.edits) {
                const auto applied = doc.apply(edit.address.path, edit.action);
                ASSERT_TRUE(applied);
                Write write{applied->node, {}, {}, commit.user.value == "ann"};
                if (const auto* set = std::get_if<SetField>(&edit.action)) {
                    write.isSet = true;
                    write.field = set->field;
                    write.part = set->part;
                } else if (const auto* erase = std::get_if<EraseField>(&edit.action)) {
                    write.field = erase->field;
                    write.part = erase->part;
                } else {
                    continue;
                }
                std::erase_if(writes, [&](const Write& other) {
                    return other.node == write.node && other.field == write.field &&
                           overlap(other.part, write.part);
                });
                writes.push_back(std::move(write));
            }
        }
        const auto result =
            reverted(history, [](const Commit& commit) { return commit.user.value == "ann"; });
        kept += result.kept.size();
        for (const Write& write : writes) {
            const std::string now = pathOfNode(result.present, write.node);
            if (write.isAnns || now.empty()) continue;
            const auto content = contentOf(result.present.field(now, write.field), write.part);
            // A part of another form has replaced the field.
            if (write.isSet && !content) continue;
            const std::string then = pathOfNode(result.after, write.node);
            ASSERT_FALSE(then.empty()) << now << " has gone with the work of others in it";
            ASSERT_EQ(contentOf(result.after.field(then, write.field), write.part), content)
                << now << " " << write.field;
            ++stayed;
        }
    }
    EXPECT_GT(stayed, seedsOf(400));
    EXPECT_GT(kept, seedsOf(400) / 4);
}

TEST(Reversal, OneCommitAmongOthers) {
    LayerDoc before;
    ASSERT_TRUE(before.apply("/A", CreateSpec{SpecKind::Prim}));
    ASSERT_TRUE(before.apply("/A", setInt("f", 1)));
    Reversal reversal({{kLayer, before}});
    const auto add = [&](const char* user, bool chosen, std::vector<Edit> edits) {
        Commit commit;
        commit.user = UserName{user};
        commit.edits = std::move(edits);
        ASSERT_TRUE(reversal.add(commit, [&](const Edit&) { return chosen; }));
    };
    add("bob", true,
        {{kLayer, {"/A", {}}, setInt("f", 2), {}}, {kLayer, {"/A", {}}, setInt("g", 2), {}}});
    add("ann", false, {{kLayer, {"/A", {}}, MoveSpec{{"/", {}}, "B"}, {}}});
    add("ann", false, {{kLayer, {"/B", {}}, setInt("g", 3), {}}});
    add("cy", false, {{LayerId{"other.usda"}, {"/X", {}}, setInt("g", 3), {}}});
    EXPECT_EQ(reversal.chosen(), 2u);
    const auto taken = reversal.takeBack();
    ASSERT_EQ(taken.edits.size(), 1u);
    EXPECT_EQ(taken.edits.front().path, "/B");
    EXPECT_EQ(taken.edits.front().action, EditAction(setInt("f", 1)));
    ASSERT_EQ(taken.kept.size(), 1u);
    EXPECT_EQ(taken.kept.front().field, "g");
    EXPECT_EQ(taken.kept.front().author.value, "ann");
}

TEST(Reversal, AnImportStays) {
    Reversal reversal({{kLayer, LayerDoc()}});
    Commit import;
    import.imported = kLayer;
    import.edits = {{kLayer, {"/A", {}}, CreateSpec{SpecKind::Prim}, {}}};
    ASSERT_TRUE(reversal.add(import, [](const Edit&) { return true; }));
    EXPECT_EQ(reversal.chosen(), 0u);
    EXPECT_TRUE(reversal.takeBack().edits.empty());
    EXPECT_TRUE(reversal.layers().at(kLayer).has("/A"));
}

TEST(Reversal, CommitsThatDoNotFollowAreAnError) {
    Reversal reversal({{kLayer, LayerDoc()}});
    Commit commit;
    commit.edits = {{kLayer, {"/None", {}}, setInt("f", 1), {}}};
    EXPECT_FALSE(reversal.add(commit, [](const Edit&) { return true; }));
}
