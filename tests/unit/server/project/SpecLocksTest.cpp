// Tests who may edit a locked spec (LK5).
#include "usdlive/common/layer/SpecLocks.h"

#include <gtest/gtest.h>

#include "FakeHost.h"
#include "unit/common/layer/SpecLockEdits.h"
#include "usdlive/common/core/ByteStream.h"

namespace usdlive::server::projecttest {
namespace {

const LayerId kRoot{"a.usda"}, kSub{"b.usda"};

Value subLayer(const std::string& path) {
    Bytes bytes;
    appendText(bytes, path);
    appendNumber<double>(bytes, 0);
    appendNumber<double>(bytes, 1);
    return {ValueType::SubLayer, std::move(bytes)};
}

/// user1 has locked /A.x on the stage of a.usda; b.usda is a sublayer of a.usda.
class ProjectSpecLocks : public ::testing::Test {
protected:
    ProjectSpecLocks() {
        world.options.administrators = {{"user3"}};
        world.start();
        for (const SessionId session : {1, 2, 3}) world.join(session);
        LayerDoc root = World::sample();
        ListOp subLayers;
        subLayers.itemType = ValueType::SubLayer;
        subLayers.isExplicit = true;
        subLayers[ListName::Explicit] = {subLayer("./b.usda")};
        EXPECT_TRUE(root.apply("/", SetField{"subLayers", {}, subLayers, {}}));
        world.receive(1, ControlMessage(OpenLayer{1, kRoot, 0}));
        world.project->layerLoaded(kRoot, LoadedLayer{root});
        world.receive(1, ControlMessage(OpenLayer{2, kSub, 0}));
        world.project->layerLoaded(kSub, LoadedLayer{World::sample()});
        EXPECT_EQ(refusal(1, {lock("/A.x", {"user1"})}), "");
    }
    static Edit lock(const std::string& path, const UserName& owner) {
        return {kRoot, {"/", {}}, specLockEdit(path, owner)};
    }
    static Edit unlock(const std::string& path) { return {kRoot, {"/", {}}, specUnlockEdit(path)}; }
    /// Returns the refusal; empty if the transaction was committed.
    std::string refusal(SessionId session, std::vector<Edit> edits) {
        world.host.sent.clear();
        const LayerDoc before = *world.project->layer(kSub);
        world.submit(session, ++sequences[session], std::move(edits),
                     world.project->durableRevision());
        world.store();
        const Frame frame = world.next(session);
        const auto* refused = std::get_if<RefusalFrame>(&frame);
        if (!refused) return "";
        EXPECT_EQ(refused->error.code, ErrorCode::Locked);
        EXPECT_TRUE(*world.project->layer(kSub) == before) << "the refused edit left nothing";
        refusedEdit = refused->edit;
        return refused->error.message;
    }

    World world;
    std::map<SessionId, std::uint64_t> sequences;
    std::uint32_t refusedEdit = 0;
};

TEST_F(ProjectSpecLocks, LK5HoldsInEveryLayerOfTheStack) {
    for (const LayerId& layer : {kRoot, kSub}) {
        EXPECT_EQ(refusal(2, {create("/N", kSub), set("/A.x", 1, layer)}),
                  "/A.x is locked by user1");
        EXPECT_EQ(refusedEdit, 1u);
        EXPECT_EQ(refusal(1, {set("/A.x", 2, layer)}), "");
        EXPECT_EQ(refusal(3, {set("/A.x", 3, layer)}), "") << "an administrator";
    }
    EXPECT_EQ(refusal(2, {create("/A/New"), create("/B/New", kSub)}), "");
}

TEST_F(ProjectSpecLocks, LK5PreviewsOfALockedSpecAreNotPassedOn) {
    const auto seen = [&](SessionId author, std::vector<Edit> edits) {
        world.host.sent.clear();
        world.receive(author, Frame(PreviewFrame{world.client(author), ++sequences[author],
                                                 world.project->durableRevision(), edits}));
        return !world.silent(author == 1 ? 2 : 1);
    };
    for (const LayerId& layer : {kRoot, kSub}) {
        EXPECT_FALSE(seen(2, {set("/A.x", 1, layer)}));
        EXPECT_FALSE(seen(2, {move("/A", "/B", "C", layer)}));
        EXPECT_TRUE(seen(1, {set("/A.x", 1, layer)}));
        EXPECT_TRUE(seen(3, {set("/A.x", 1, layer)})) << "an administrator";
        EXPECT_TRUE(seen(2, {create("/A/New", layer)}));
    }
}

// The locks of a root layer apply to other layers, so the root layer stays loaded.
TEST_F(ProjectSpecLocks, LK5HoldsWhenNobodyHasTheLayersOpen) {
    world.receive(1, ControlMessage(CloseLayer{kRoot}));
    world.receive(1, ControlMessage(CloseLayer{kSub}));
    world.host.nowMs += 2 * world.options.idleLayerMs;
    world.project->unloadIdle();
    ASSERT_NE(world.project->layer(kSub), nullptr);
    EXPECT_EQ(refusal(2, {set("/A.x", 1, kSub)}), "/A.x is locked by user1");
    EXPECT_EQ(refusal(1, {unlock("/A.x")}), "");
    world.host.nowMs += 2 * world.options.idleLayerMs;
    world.project->unloadIdle();
    EXPECT_EQ(world.project->layer(kRoot), nullptr);
    EXPECT_EQ(world.project->layer(kSub), nullptr);
}

TEST_F(ProjectSpecLocks, LK5AncestorsOfALockedSpecAreNeitherMovedNorDeleted) {
    EXPECT_EQ(refusal(2, {erase("/A", kSub)}), "/A.x is locked by user1");
    EXPECT_EQ(refusal(2, {move("/A", "/B", "C")}), "/A.x is locked by user1");
    EXPECT_EQ(refusal(2, {erase("/B", kSub)}), "");
}

TEST_F(ProjectSpecLocks, LK5HoldsForSpecsThatTheEditItselfCreates) {
    EXPECT_EQ(refusal(1, {erase("/A", kSub)}), "");
    const std::uint64_t next = sequences[2] + 1;
    EXPECT_EQ(
        refusal(
            2, {create("/A", kSub), inCreated(next, 0, ".x", CreateSpec{SpecKind::Attribute}, kSub),
                inCreated(next, 1, "", SetField{"default", {}, doubleValue(1), {}}, kSub)}),
        "/A.x is locked by user1");
    EXPECT_EQ(refusedEdit, 2u);
    EXPECT_EQ(refusal(2, {create("/A", kSub)}), "") << "an over has no content";
}

TEST_F(ProjectSpecLocks, LK5OnlyANewOverIsAllowed) {
    const auto specifier = [](std::uint8_t number) {
        return SetField{"specifier", {}, Value(ValueType::Specifier, Bytes{number}), {}};
    };
    constexpr std::uint8_t kDef = 0, kOver = 1;
    EXPECT_EQ(refusal(1, {{kSub, {"/A", {}}, specifier(kDef)}, lock("/A", {"user1"})}), "");
    EXPECT_EQ(refusal(2, {{kSub, {"/A", {}}, specifier(kOver)}}), "/A is locked by user1");
    EXPECT_EQ(refusal(2, {{kSub, {"/A", {}}, usdlive::EraseField{"specifier", {}}}}),
              "/A is locked by user1");
    const auto with = [&](std::uint8_t number) {
        return std::vector{create("/A", kSub),
                           inCreated(sequences[2] + 1, 0, "", specifier(number), kSub)};
    };
    EXPECT_EQ(refusal(2, with(kOver)), "")
        << "it is the parent of a spec that was created meanwhile";
    EXPECT_EQ(*world.project->layer(kSub)->field("/A", "specifier"),
              FieldValue(Value(ValueType::Specifier, Bytes{kDef})));
    EXPECT_EQ(refusal(1, {erase("/A", kSub)}), "");
    EXPECT_EQ(refusal(2, with(kDef)), "/A is locked by user1");
    EXPECT_EQ(refusal(2, with(kOver)), "");
}

TEST_F(ProjectSpecLocks, LK5OnlyItsOwnerTakesAndEndsALock) {
    EXPECT_EQ(refusal(2, {unlock("/A.x")}), "/A.x is locked by user1");
    EXPECT_EQ(refusal(2, {{kRoot, {"/", {}}, usdlive::EraseField{"customLayerData", {}}}}),
              "/A.x is locked by user1");
    EXPECT_NE(refusal(2, {lock("/B", {"user1"})}), "");
    EXPECT_EQ(refusal(2, {lock("/B", {"user2"})}), "");
    EXPECT_EQ(refusal(1, {unlock("/A.x")}), "");
    EXPECT_EQ(refusal(2, {set("/A.x", 1, kSub)}), "");
    EXPECT_EQ(refusal(1, {{kSub, {"/B", {}}, SetField{"comment", {}, stringValue("x"), {}}}}),
              "/B is locked by user2");
    // The holder has been away for long.
    world.project->disconnected(2);
    world.host.nowMs += 16 * 60'000;
    EXPECT_EQ(refusal(1, {unlock("/B")}), "");
}

TEST_F(ProjectSpecLocks, LK5IsKeptByAReload) {
    FileStamp file;
    const auto reload = [&](SessionId session) {
        world.receive(session, ControlMessage(ReloadLayers{9, {kSub}}));
        const auto asked = world.host.reloading.front();
        world.host.reloading.pop_front();
        LayerDoc content = World::sample();
        EXPECT_TRUE(content.apply("/A.x", SetField{"default", {}, doubleValue(5), {}}));
        world.host.sent.clear();
        world.project->layerReloaded(session, 9, kSub,
                                     makeReload(kSub, asked.present, content, file));
        world.store();
    };
    reload(2);
    EXPECT_EQ(world.nextControl<LayersReloaded>(2).failed.at(0).code, "locked");
    EXPECT_TRUE(*world.project->layer(kSub) == World::sample());
    reload(1);
    world.nextFrame<CommitFrame>(1);
    EXPECT_EQ(world.nextControl<LayersReloaded>(1).reloaded.size(), 1u);
}

}  // namespace
}  // namespace usdlive::server::projecttest
