// Tests edits of places and the paths in values of execute() (M15, M16).
#include <gtest/gtest.h>

#include "RandomEdits.h"
#include "usdlive/common/core/ByteStream.h"
#include "usdlive/common/layer/AddressResolver.h"
#include "usdlive/common/layer/PathsInValues.h"
#include "usdlive/common/layer/TransactionExecutor.h"

namespace usdlive::places {

namespace {

const LayerId kStageRoot{"root.usda"}, kAnimLayer{"anim.usda"};
const CreateSpec kNewPrim{SpecKind::Prim}, kNewAttribute{SpecKind::Attribute},
    kRelationship{SpecKind::Relationship};

Edit in(const LayerId& layer, std::string path, EditAction action,
        std::optional<Creation> creation = {}) {
    return {layer, {std::move(path), creation}, std::move(action)};
}
Edit inRoot(std::string path, EditAction action, std::optional<Creation> creation = {}) {
    return in(kStageRoot, std::move(path), std::move(action), creation);
}
MoveSpec moveUnder(std::string parent, std::string name, bool place = false) {
    return {{std::move(parent), {}}, std::move(name), place};
}
SetField target(std::string_view path) {
    return {"targetPaths", ListItem{ListName::Explicit, pathValue(path), {}}, {}, ValueType::Path};
}
EraseField noTarget(std::string_view path) {
    return {"targetPaths", ListItem{ListName::Explicit, pathValue(path), {}}};
}
ListOp targets(const std::vector<std::string_view>& paths) {
    ListOp list{ValueType::Path, true, {}};
    for (const auto path : paths) list[ListName::Explicit].push_back(pathValue(path));
    return list;
}

// Returns what a namespace editor writes for a move of a prim that has a spec in the root.
std::vector<Edit> batch(const std::string& from, const std::string& parent,
                        const std::string& name) {
    return {inRoot(from, moveUnder(parent, name)), inRoot(from, moveUnder(parent, name, true)),
            in(kAnimLayer, from, moveUnder(parent, name, true))};
}
std::vector<Edit> deletion(const std::string& path) {
    return {inRoot(path, DeleteSpec{}), inRoot(path, DeleteSpec{true}),
            in(kAnimLayer, path, DeleteSpec{true})};
}

// Two authors, "ada" and "bo", who each name the revision that they have seen.
struct Project {
    LayerDocs layers{{kStageRoot, {}}, {kAnimLayer, {}}};
    NamespaceLog log;
    std::map<std::string, OwnCreations> creations;
    Revision revision = 0;
    std::uint64_t sequence = 0;

    Project() {
        commit("ada", {inRoot("/W", kNewPrim), inRoot("/W/Chair", kNewPrim),
                       inRoot("/W/Chair.x", kNewAttribute), inRoot("/W/Table", kNewPrim),
                       inRoot("/W/Table.near", kRelationship)});
    }

    Executed commit(const std::string& author, std::vector<Edit> edits,
                    std::optional<Revision> base = {}) {
        const Transaction transaction{
            {{author}, ++sequence}, base.value_or(revision), 0, std::move(edits)};
        Outcome outcome = execute(layers, log, creations[author], transaction, revision + 1);
        const auto* refused = std::get_if<Refused>(&outcome);
        EXPECT_EQ(refused, nullptr) << refused->error.message;
        if (refused) return {};
        ++revision;
        return std::get<Executed>(std::move(outcome));
    }
    [[nodiscard]] FieldValue near() const {
        for (const char* path : {"/W/Table.near", "/Earth/Table.near"})
            if (const auto* field = layers.at(kStageRoot).field(path, "targetPaths")) return *field;
        return {};
    }
    [[nodiscard]] bool has(const LayerId& layer, std::string_view path) const {
        return layers.at(layer).has(path);
    }
};

// The first opinion about the chair in the layer of an animator.
std::vector<Edit> firstOpinion(std::uint64_t sequence) {
    return {in(kAnimLayer, "/W", kNewPrim),
            in(kAnimLayer, "/Chair", kNewPrim, Creation{sequence, 0}),
            in(kAnimLayer, ".x", kNewAttribute, Creation{sequence, 1}),
            in(kAnimLayer, "", setInt("default", 5), Creation{sequence, 2})};
}

}  // namespace

TEST(Places, M15ATargetFollowsTheRenameOfItsPrim) {
    Project project;
    const Revision seen = project.revision;
    project.commit("bo", batch("/W/Chair", "/W", "Stool"));
    project.commit("bo", batch("/W", "/", "Earth"));
    project.commit("ada", {inRoot("/W/Table.near", target("/W/Chair"))}, seen);
    EXPECT_EQ(project.near(), FieldValue(targets({"/Earth/Stool"})));
    project.commit("ada", {inRoot("/W/Table.near", noTarget("/W/Chair"))}, seen);
    EXPECT_EQ(project.near(), FieldValue(targets({})));
}

TEST(Places, M15AFirstOpinionFollows) {
    Project project;
    const Revision seen = project.revision;
    project.commit("bo", batch("/W/Chair", "/W", "Stool"));
    const auto executed = project.commit("ada", firstOpinion(project.sequence + 1), seen);
    EXPECT_TRUE(executed.dropped.empty());
    EXPECT_TRUE(project.has(kAnimLayer, "/W/Stool.x"));
    EXPECT_FALSE(project.has(kAnimLayer, "/W/Chair"));
}

TEST(Places, M15AFirstOpinionThatWasThereFirstFollows) {
    for (const std::string parent : {"/W", "/W/Table"}) {
        Project project;
        const Revision seen = project.revision;
        project.commit("bo", firstOpinion(project.sequence + 1), seen);
        project.commit("ada", batch("/W/Chair", parent, "Stool"), seen);
        EXPECT_TRUE(project.has(kAnimLayer, parent + "/Stool.x")) << parent;
        EXPECT_FALSE(project.has(kAnimLayer, "/W/Chair"));
    }
}

TEST(Places, M15AFirstOpinionAboutADeletedPrimIsDropped) {
    Project project;
    const Revision seen = project.revision;
    project.commit("bo", deletion("/W/Chair"));
    const auto executed = project.commit("ada", firstOpinion(project.sequence + 1), seen);
    EXPECT_EQ(executed.dropped.size(), 3u);
    EXPECT_FALSE(project.has(kAnimLayer, "/W/Chair"));
    const auto targeted =
        project.commit("ada", {inRoot("/W/Table.near", target("/W/Chair"))}, seen);
    EXPECT_EQ(targeted.dropped.size(), 1u);
}

TEST(Places, M15AnotherPrimAtAVacatedPlaceStaysThere) {
    Project project;
    const Revision seen = project.revision;
    project.commit("ada", batch("/W/Chair", "/W", "Stool"), seen);
    const std::uint64_t moved = project.sequence;
    // The author has not seen the commit: the place is named by the edit that vacated it.
    Edit named = inRoot("/W/Table.near", target("/W/Chair"));
    named.names = {{"", Creation{moved, 1}}};
    project.commit("ada", {inRoot("", kNewPrim, Creation{moved, 1}), std::move(named)}, seen);
    EXPECT_TRUE(project.has(kStageRoot, "/W/Chair"));
    EXPECT_EQ(project.near(), FieldValue(targets({"/W/Chair"})));
    // Others' moves of what is above carry it.
    project.commit("bo", batch("/W", "/", "Earth"));
    project.commit("ada", {inRoot("/Leg", kNewPrim, Creation{moved, 1})}, seen);
    EXPECT_TRUE(project.has(kStageRoot, "/Earth/Chair/Leg"));
}

// Somebody moves an object into a prim that the author has moved before creating the object.
TEST(Places, M15WhatOthersMoveIntoAMovedPrimGoesWithIt) {
    Project project;
    const Revision seen = project.revision;
    project.commit("bo", {inRoot("/New/Leg", moveUnder("/W/Table", "Leg", true))});
    project.commit("ada", {inRoot("/W/Table", moveUnder("/W", "Desk"))}, seen);
    const Creation created{project.sequence + 1, 0};
    const auto executed =
        project.commit("ada", {inRoot("/New", kNewPrim), inRoot("/Leg", kNewPrim, created)}, seen);
    EXPECT_TRUE(executed.dropped.empty());
    EXPECT_TRUE(project.has(kStageRoot, "/W/Desk/Leg"));
    EXPECT_FALSE(project.has(kStageRoot, "/New/Leg"));
}

// The layer has the object, and nothing at either of its new parents.
TEST(Places, M15TheLastOfSeveralMovesOfAnObjectDecides) {
    Project project;
    const Revision seen = project.revision;
    project.commit("bo", firstOpinion(project.sequence + 1), seen);
    const auto executed =
        project.commit("ada",
                       {in(kAnimLayer, "/W/Chair", moveUnder("/W/Table", "Stool", true)),
                        in(kAnimLayer, "/W/Chair", moveUnder("/W/Table", "Bench", true))},
                       seen);
    EXPECT_TRUE(project.has(kAnimLayer, "/W/Table/Bench.x"));
    EXPECT_FALSE(project.has(kAnimLayer, "/W/Table/Stool"));

    Commit commit;
    commit.revision = project.revision;
    for (const ExecutedEdit& one : executed.edits) commit.edits.push_back(one.edit);
    const auto created = createdBy(project.log, commit);
    for (const std::uint32_t edit : {0u, 1u}) {
        const Creation vacated{project.sequence, edit};
        const auto* entry = project.creations["ada"].find(vacated);
        ASSERT_NE(entry, nullptr);
        EXPECT_EQ(entry->mark, created.at(edit).mark) << edit;
    }
    // The place that it has left is free.
    const Creation vacated{project.sequence, 0};
    project.commit("ada", {in(kAnimLayer, "", kNewPrim, vacated)}, seen);
    EXPECT_TRUE(project.has(kAnimLayer, "/W/Chair"));
}

TEST(Places, M15TheLastOfTwoRenamesWinsAndTargetsNameOne) {
    Project project;
    project.commit("ada", {inRoot("/W/Table.near", target("/W/Chair"))});
    const Revision seen = project.revision;
    const auto renamed = [&](const std::string& author, const std::string& name) {
        auto edits = batch("/W/Chair", "/W", name);
        Edit erase = inRoot("/W/Table.near", noTarget("/W/Chair"));
        erase.names = {{"", Creation{project.sequence + 1, 1}}};
        Edit set = inRoot("/W/Table.near", target("/W/" + name));
        set.names = {{"/W/Chair", {}}};
        edits.push_back(std::move(erase));
        edits.push_back(std::move(set));
        project.commit(author, std::move(edits), seen);
    };
    renamed("bo", "Bench");
    renamed("ada", "Stool");
    EXPECT_TRUE(project.has(kStageRoot, "/W/Stool.x"));
    EXPECT_EQ(project.near(), FieldValue(targets({"/W/Stool"})));
}

TEST(Places, M15APlaceEditOfADeletedObjectDoesNothing) {
    Project project;
    const Revision seen = project.revision;
    project.commit("bo", deletion("/W/Chair"));
    project.commit("bo", {inRoot("/W/Chair", kNewPrim)});
    const auto executed = project.commit("ada", batch("/W/Chair", "/W", "Stool"), seen);
    EXPECT_EQ(executed.dropped.size(), 1u);  // the move of the spec
    EXPECT_TRUE(project.has(kStageRoot, "/W/Chair"));
    EXPECT_FALSE(project.has(kStageRoot, "/W/Stool"));
}

TEST(Places, M15RelocatesAreCarriedByTheirParents) {
    Project project;
    const auto relocate = [](std::string_view from, std::string_view to) {
        return inRoot("/", SetField{"layerRelocates", MapKey{pathValue(from)}, pathValue(to),
                                    ValueType::Path});
    };
    const auto relocates = [&] {
        std::vector<std::string> all;
        for (const auto& [from, to] :
             project.layers.at(kStageRoot).field("/", "layerRelocates")->as<Map>()->entries)
            all.push_back(std::string(*textOf(from)) + " " + std::string(*textOf(to)));
        return all;
    };
    const Revision seen = project.revision;
    // Two relocate the same prim.
    project.commit("bo",
                   {inRoot("/W/Chair/Part", moveUnder("/W/Chair", "Bit", true)),
                    relocate("/W/Chair/Part", "/W/Chair/Bit")},
                   seen);
    project.commit("ada",
                   {inRoot("/W/Chair/Part", moveUnder("/W/Chair", "Piece", true)),
                    relocate("/W/Chair/Part", "/W/Chair/Piece")},
                   seen);
    EXPECT_EQ(relocates(), std::vector<std::string>{"/W/Chair/Part /W/Chair/Piece"});
    // One relocates, the other renames the parent.
    const Revision later = project.revision;
    project.commit("bo", batch("/W/Chair", "/W", "Stool"));
    project.commit("ada", {relocate("/W/Chair/Part", "/W/Chair/Thing")}, later);
    EXPECT_TRUE(std::ranges::count(relocates(), "/W/Stool/Part /W/Stool/Thing") == 1);
}

TEST(Places, M16PathsThatARenameHadNotSeenAreCorrected) {
    Project project;
    const Revision seen = project.revision;
    project.commit("bo", {inRoot("/W/Table.near", target("/W/Chair.x")),
                          inRoot("/W/Table.near", target("/W/Table"))});
    project.commit("ada", batch("/W/Chair", "/W", "Stool"), seen);
    EXPECT_EQ(project.near(), FieldValue(targets({"/W/Stool.x", "/W/Table"})));
    // Also if it is not known any more which paths these are.
    const Revision later = project.revision;
    project.commit("bo", {inRoot("/W/Table.near", target("/W/Stool"))});
    project.log.forgetNamings(project.revision);
    project.commit("ada", batch("/W/Stool", "/W", "Bench"), later);
    EXPECT_EQ(project.near(), FieldValue(targets({"/W/Bench.x", "/W/Table", "/W/Bench"})));
}

TEST(Places, M16PathsToADeletedPrimAreRemoved) {
    Project project;
    const Revision seen = project.revision;
    project.commit("bo", {inRoot("/W/Table.near", target("/W/Chair"))});
    project.commit("ada", deletion("/W/Chair"), seen);
    EXPECT_EQ(project.near(), FieldValue(targets({})));
}

TEST(Places, M16TheAuthorsOwnPathsStay) {
    Project project;
    const Revision seen = project.revision;
    project.commit("bo", {inRoot("/W/Table", setInt("other", 1))});
    auto edits = batch("/W/Chair", "/W", "Stool");
    const Creation vacated{project.sequence + 1, 1};
    edits.push_back(inRoot("", kNewPrim, vacated));
    Edit named = inRoot("/W/Table.near", target("/W/Chair"));
    named.names = {{"", vacated}};
    edits.push_back(std::move(named));
    project.commit("ada", std::move(edits), seen);
    EXPECT_EQ(project.near(), FieldValue(targets({"/W/Chair"})));
}

TEST(Places, APlaceMovesNothingOntoAnotherSpec) {
    Project project;
    project.commit("bo", {in(kAnimLayer, "/W", kNewPrim), in(kAnimLayer, "/W/Chair", kNewPrim),
                          in(kAnimLayer, "/W/Stool", kNewPrim)});
    project.commit("ada", {in(kAnimLayer, "/W/Chair", moveUnder("/W", "Stool", true))});
    EXPECT_TRUE(project.has(kAnimLayer, "/W/Chair"));
}

TEST(PathsInValues, AreFoundAndReplacedInEveryForm) {
    Dictionary inner, outer;
    inner.entries["path"] = pathValue("/W/Chair");
    inner.entries["number"] = intValue(1);
    outer.entries["inner"] = inner;
    const auto arc = [](std::string_view asset, std::string_view prim) {
        Bytes bytes;
        appendText(bytes, asset);
        appendText(bytes, prim);
        bytes.resize(bytes.size() + 2 * sizeof(double));
        return Value(ValueType::Payload, std::move(bytes));
    };
    ListOp arcs{ValueType::Payload, false, {}};
    arcs[ListName::Prepended].push_back(arc("", "/W/Chair"));
    arcs[ListName::Prepended].push_back(arc("a.usda", "/W/Chair"));
    const Map relocates{ValueType::Path, {{pathValue("/W/Chair"), pathValue("/W/Chair/A")}}};
    const std::vector<std::pair<FieldValue, int>> contents{
        {FieldValue(pathValue("/W/Chair.x")), 1},
        {FieldValue(pathValue("relative")), 0},
        {FieldValue(stringValue("/W/Chair")), 0},
        {FieldValue(outer), 1},
        {FieldValue(targets({"/W/Chair", "/W/Stool", "/W/Table"})), 3},
        {FieldValue(arcs), 1},
        {FieldValue(relocates), 2}};
    for (const auto& [content, count] : contents) {
        const SetField set{"f", {}, content, {}};
        int found = 0;
        forEachPath(set, [&](std::string_view, PathRole) { ++found; });
        EXPECT_EQ(found, count);
        FieldValue moved = content;
        EXPECT_TRUE(changePaths(moved, [](std::string_view path, PathRole) {
            return std::optional(path.starts_with("/W/Chair")
                                     ? "/W/Stool" + std::string(path.substr(8))
                                     : std::string(path));
        }));
        EXPECT_EQ(moved != content, count > 0);
        const auto* list = moved.as<ListOp>();
        if (list && list->itemType == ValueType::Path) {  // equal items are there once
            EXPECT_EQ(*list, targets({"/W/Stool", "/W/Table"}));
        }
    }
}

}  // namespace usdlive::places
