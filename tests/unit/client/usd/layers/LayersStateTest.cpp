// Tests the states of layers: muted, locked, dirty, outdated, names.
#include "usdlive/client/usd/layers/LayersState.h"

#include <pxr/base/vt/dictionary.h>
#include <pxr/usd/sdf/changeBlock.h>
#include <sys/stat.h>

#include <chrono>

#include "LayersFixture.h"
#include "usd/layers/OmniLayerData.h"

namespace usdlive::layers {

namespace fs = std::filesystem;

class LayersStateTest : public LayersFixture {
protected:
    LayersState& state() { return layers().state(); }
    std::string strongId() const { return strong->GetIdentifier(); }
    [[nodiscard]] bool isMuted(const std::string& id) {
        const auto muted = host().mutedLayers();
        return std::ranges::find(muted, id) != muted.end();
    }
};

TEST_F(LayersStateTest, EachScopeOfMutenessKeepsItsOwnFlags) {
    host().muteAndUnmute({strongId()}, {});
    auto events = frameEvents();
    ASSERT_TRUE(find(events, LayerEventType::MutenessStateChanged));
    EXPECT_TRUE(state().isLayerLocallyMuted(strongId()));
    EXPECT_FALSE(state().isLayerGloballyMuted(strongId()));
    EXPECT_FALSE(state().isLayerWritable(strongId()));

    const auto& other = weak->GetIdentifier();
    ASSERT_TRUE(state().setLayerGlobalMuteness(other, true));
    EXPECT_TRUE(state().isLayerGloballyMuted(other));
    EXPECT_FALSE(isMuted(other)) << "the scope is local";

    state().setMutenessScope(true);
    EXPECT_TRUE(isMuted(other));
    EXPECT_FALSE(isMuted(strongId()));
    EXPECT_TRUE(state().isLayerLocallyMuted(strongId()));
    events = frameEvents();
    EXPECT_TRUE(find(events, LayerEventType::MutenessScopeChanged));

    // In global scope, muting on the stage mutes for everybody, and is stored.
    host().muteAndUnmute({strongId()}, {other});
    frame();
    EXPECT_TRUE(state().isLayerGloballyMuted(strongId()));
    EXPECT_FALSE(state().isLayerGloballyMuted(other));
    EXPECT_TRUE(layerFlags(root, "muteness").at(strongId()));
    state().setMutenessScope(false);
    EXPECT_TRUE(isMuted(strongId()));
    EXPECT_EQ(refusal(state().setLayerGlobalMuteness(root->GetIdentifier(), true)),
              LayerErrorType::InvalidParam);
}

TEST_F(LayersStateTest, GlobalMutenessOfAnotherEditorIsFollowedWithTheFrame) {
    state().setMutenessScope(true);
    frame();
    ASSERT_TRUE(setLayerFlags(root, "muteness", {{strongId(), true}}));
    EXPECT_TRUE(state().isLayerGloballyMuted(strongId()));
    EXPECT_FALSE(isMuted(strongId()));
    frame();
    EXPECT_TRUE(isMuted(strongId()));
}

TEST_F(LayersStateTest, ALockIsInTheLayerAndInTheRootsMap) {
    ASSERT_TRUE(state().setLayerLockState(strongId(), true));
    EXPECT_TRUE(state().isLayerLocked(strongId()));
    EXPECT_FALSE(state().isLayerWritable(strongId()));
    EXPECT_FALSE(state().isLayerReadonlyOnDisk(strongId()));
    EXPECT_TRUE(omniValue(strong, "locked").GetWithDefault<bool>(false));
    EXPECT_TRUE(layerFlags(root, "locked").at(strongId()));
    EXPECT_TRUE(find(frameEvents(), LayerEventType::LockStateChanged));
    ASSERT_TRUE(state().setLayerLockState(strongId(), false));
    EXPECT_FALSE(state().isLayerLocked(strongId()));
    EXPECT_FALSE(layerFlags(root, "locked").at(strongId())) << "stays written";

    // Either of the two flags is a lock.
    setLayerFlags(root, "locked", {{strongId(), true}});
    EXPECT_TRUE(state().isLayerLocked(strongId()));
    setLayerFlags(root, "locked", {{strongId(), false}});
    setOmniValue(strong, "locked", pxr::VtValue(true));
    EXPECT_TRUE(state().isLayerLocked(strongId()));
    EXPECT_TRUE(find(frameEvents(), LayerEventType::LockStateChanged));
}

TEST_F(LayersStateTest, FlagsThatComeTogetherWithASublayerCount) {
    (void)frameEvents();
    const auto added = pxr::SdfLayer::CreateAnonymous("added.usda");
    {
        const pxr::SdfChangeBlock block;
        root->InsertSubLayerPath(added->GetIdentifier());
        setLayerFlags(root, "locked", {{weak->GetIdentifier(), true}});
        setLayerFlags(root, "muteness", {{strongId(), true}});
    }
    EXPECT_TRUE(state().isLayerLocked(weak->GetIdentifier()));
    EXPECT_TRUE(state().isLayerGloballyMuted(strongId()));
    const auto events = frameEvents();
    EXPECT_TRUE(find(events, LayerEventType::LockStateChanged));
    EXPECT_TRUE(find(events, LayerEventType::MutenessStateChanged));
}

TEST_F(LayersStateTest, LayersThatCannotBeLockedStayUnchanged) {
    const auto lock = [this](const std::string& id) {
        return refusal(state().setLayerLockState(id, true));
    };
    EXPECT_EQ(lock(root->GetIdentifier()), LayerErrorType::InvalidParam);
    EXPECT_EQ(lock(session->GetIdentifier()), LayerErrorType::InvalidParam);
    EXPECT_EQ(lock("nowhere.usda"), LayerErrorType::NotFound);
    EXPECT_EQ(lock(""), LayerErrorType::InvalidParam);
    EXPECT_FALSE(omniValue(root, "locked").IsHolding<bool>());
    const auto unknown = state().whyUnknown("nowhere.usda");
    ASSERT_TRUE(unknown);
    EXPECT_NE(unknown->text.find("nowhere.usda"), std::string::npos);
    EXPECT_FALSE(state().whyUnknown(strongId()));
    EXPECT_FALSE(state().isLayerLocked("nowhere.usda"));
}

TEST_F(LayersStateTest, TheRootOfAnotherStageKeepsItsMap) {
    setLayerFlags(strong, "locked", {{weak->GetIdentifier(), true}});
    ASSERT_TRUE(state().setLayerLockState(strongId(), true));
    EXPECT_TRUE(state().isLayerLocked(strongId()));
    EXPECT_TRUE(layerFlags(strong, "locked").at(weak->GetIdentifier()));
    EXPECT_FALSE(state().isLayerLocked(weak->GetIdentifier())) << "the map of another stage";
}

TEST_F(LayersStateTest, NamesAreTheRootsTheCustomOneOrTheFiles) {
    EXPECT_EQ(state().layerName(root->GetIdentifier()), "Root Layer");
    EXPECT_EQ(state().layerName(session->GetIdentifier()), "Session Layer");
    EXPECT_EQ(state().layerName(strongId()), strongId());
    EXPECT_TRUE(state().setLayerName(strongId(), "Animation"));
    EXPECT_EQ(state().layerName(strongId()), "Animation");
    EXPECT_EQ(state().layerName("/a/my%20layer.usda"), "my layer.usda");
    EXPECT_FALSE(state().setLayerName("nowhere.usda", "x"));
}

TEST_F(LayersStateTest, LocalLayersAreListedWithMissingOnes) {
    root->InsertSubLayerPath("/nowhere/gone.usda");
    strong->InsertSubLayerPath(root->GetIdentifier());  // a circle
    const auto all = state().localLayerIdentifiers(true, true, true);
    EXPECT_EQ(all,
              (std::vector<std::string>{root->GetIdentifier(), strongId(), weak->GetIdentifier(),
                                        session->GetIdentifier(), "/nowhere/gone.usda"}));
    EXPECT_TRUE(state().localLayerIdentifiers(false, false, false).empty());
    EXPECT_TRUE(state().hasLocalLayer(strongId()));
    EXPECT_FALSE(state().hasLocalLayer("/nowhere/gone.usda"));
}

TEST(LayersStateFiles, FilesAreWatched) {
    const fs::path folder = fs::temp_directory_path() / "usdlive-layers-state";
    fs::remove_all(folder);
    fs::create_directories(folder);
    const auto sub = pxr::SdfLayer::CreateNew((folder / "sub.usda").string());
    const auto root = pxr::SdfLayer::CreateNew((folder / "root.usda").string());
    root->InsertSubLayerPath("./sub.usda");
    root->Save();
    sub->Save();
    Layers layers(std::make_unique<LayerStackHost>(root));
    auto& state = layers.state();
    double now = 0;
    const auto look = [&] {
        layers.update(now += 1000);
        return layers.takeEvents();
    };
    const auto has = [](const std::vector<LayerEvent>& events, LayerEventType type) {
        return std::ranges::find(events, type, &LayerEvent::type) != events.end();
    };
    (void)look();
    const auto& id = sub->GetIdentifier();
    EXPECT_FALSE(state.isLayerOutdated(id));
    EXPECT_FALSE(state.layerOwner(id).empty());
    EXPECT_TRUE(state.isLayerSavable(id));

    sub->SetComment("edited here");
    EXPECT_TRUE(has(look(), LayerEventType::DirtyStateChanged));
    EXPECT_EQ(state.dirtyLayerIdentifiers(), std::vector{id});
    ASSERT_TRUE(sub->Save());
    EXPECT_FALSE(has(look(), LayerEventType::OutdateStateChanged))
        << "the file was saved by this process";

    fs::last_write_time(folder / "sub.usda",
                        fs::file_time_type::clock::now() + std::chrono::hours(1));
    EXPECT_FALSE(has(look(), LayerEventType::OutdateStateChanged)) << "touched without a change";
    std::ofstream(folder / "sub.usda") << "#usda 1.0\n(\n    \"edited elsewhere\"\n)\n";
    EXPECT_TRUE(has(look(), LayerEventType::OutdateStateChanged));
    EXPECT_TRUE(state.isLayerOutdated(id));
    EXPECT_EQ(state.outdatedLayerIdentifiers(LayersState::Which::Sublayers, false),
              std::vector{id});
    EXPECT_TRUE(state.outdatedLayerIdentifiers(LayersState::Which::NonSublayers, false).empty());
    ASSERT_TRUE(state.reloadOutdatedLayers(LayersState::Which::All, false));
    EXPECT_EQ(sub->GetComment(), "edited elsewhere");
    EXPECT_FALSE(state.isLayerOutdated(id));

    EXPECT_EQ(state.addAutoReloadLayer(id), LayersState::Outcome::Changed);
    EXPECT_EQ(state.addAutoReloadLayer(id), LayersState::Outcome::Unchanged);
    EXPECT_FALSE(state.addAutoReloadLayer("nowhere.usda"));
    (void)look();
    std::ofstream(folder / "sub.usda") << "#usda 1.0\n(\n    \"once more\"\n)\n";
    (void)look();
    EXPECT_EQ(sub->GetComment(), "once more");

    chmod((folder / "sub.usda").c_str(), 0444);
    EXPECT_TRUE(has(look(), LayerEventType::LayerFilePermissionChanged));
    EXPECT_TRUE(state.isLayerReadonlyOnDisk(id));
    EXPECT_FALSE(state.isLayerWritable(id));
    fs::remove_all(folder);  // nobody is notified of a removed file
    (void)look();
    EXPECT_FALSE(state.isLayerOutdated(id));
}

// Each function gives the same answer, and has the same effect, for each spelling of an identifier.
TEST(LayersStateFiles, EachSpellingOfAnIdentifierNamesTheLayer) {
    const fs::path folder = fs::temp_directory_path() / "usdlive-layers-spelling";
    fs::remove_all(folder);
    fs::create_directories(folder / "sub");
    const auto sub = pxr::SdfLayer::CreateNew((folder / "sub.usda").string());
    const auto root = pxr::SdfLayer::CreateNew((folder / "root.usda").string());
    root->InsertSubLayerPath("./sub.usda");
    Layers layers(std::make_unique<LayerStackHost>(root));
    auto& state = layers.state();
    layers.update(1000);
    const auto& id = sub->GetIdentifier();
    const std::vector spellings{id, (folder / "sub/../sub.usda").string(),
                                (folder / "./sub.usda").string(), "file://" + id};
    for (const std::string& spelling : spellings) {
        SCOPED_TRACE(spelling);
        for (const bool value : {true, false}) {
            ASSERT_TRUE(state.setLayerLockState(spelling, value));
            for (const auto& each : spellings) {
                EXPECT_EQ(state.isLayerLocked(each), value) << each;
                EXPECT_EQ(state.isLayerWritable(each), !value) << each;
            }
            EXPECT_EQ(layerFlags(root, "locked").at(id), value);
            EXPECT_EQ(layerFlags(root, "locked").size(), 1u);
            ASSERT_TRUE(state.setLayerGlobalMuteness(spelling, value));
            for (const auto& each : spellings)
                EXPECT_EQ(state.isLayerGloballyMuted(each), value) << each;
            EXPECT_EQ(layerFlags(root, "muteness").size(), 1u);
        }
        EXPECT_EQ(state.addAutoReloadLayer(spelling), LayersState::Outcome::Changed);
        for (const auto& each : spellings) EXPECT_TRUE(state.isAutoReloadLayer(each)) << each;
        EXPECT_EQ(state.removeAutoReloadLayer(spelling), LayersState::Outcome::Changed);
        EXPECT_TRUE(state.autoReloadLayers().empty());
    }
    const std::string rootSpelling = (folder / "sub/../root.usda").string();
    EXPECT_EQ(state.layerName(rootSpelling), state.layerName(root->GetIdentifier()));
    EXPECT_FALSE(state.setLayerLockState(rootSpelling, true));
    EXPECT_FALSE(state.setLayerGlobalMuteness(rootSpelling, true));
    fs::remove_all(folder);
}

}  // namespace usdlive::layers
