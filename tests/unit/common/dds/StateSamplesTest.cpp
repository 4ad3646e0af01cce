// Tests the samples of layer states and presences (DD11-DD13).
#include "usdlive/common/dds/StateSamples.h"

#include <gtest/gtest.h>

#include <cmath>
#include <string>

using namespace usdlive;
using namespace usdlive::dds;

namespace {

LayerState someState() {
    LayerState state;
    state.layer = {"shot/anim.usda"};
    state.dirty = state.locked = state.outdated = state.globallyMuted = true;
    state.writable = false;
    state.owner = "bo";
    state.revision = 43;
    state.saved = 41;
    state.holder = {"ada"};
    state.lockedAtMs = 1'700'000'000'000;
    state.editors = {{"ada"}, {"bo"}};
    return state;
}

Presence somePresence() {
    Presence presence;
    presence.client = {"c1"};
    presence.user = {"ada"};
    presence.application = "test";
    presence.selection = {"/World", "/World/A"};
    presence.camera.assign(16, 0.5);
    presence.time = 12.5;
    presence.editTarget = "shot.usda";
    presence.data = "{}";
    return presence;
}

}  // namespace

TEST(StateSamples, DD11AStateKeepsItsContent) {
    LayerState plain;
    plain.layer = {"a.usda"};
    for (const LayerState& state : {someState(), plain}) {
        const LayerStateOut out(state);
        EXPECT_EQ(layerStateOf(out.sample), state);
    }
}

TEST(StateSamples, DD12APresenceKeepsItsContent) {
    for (const Presence& presence : {somePresence(), Presence{}}) {
        const PresenceOut out(presence);
        EXPECT_EQ(presenceOf(out.sample), presence);
        EXPECT_EQ(std::string(out.sample.colour).size(), 7u);
    }
}

TEST(StateSamples, DD13InvalidSamplesAreIgnored) {
    const std::string longName(257, 'x');
    LayerState state = someState();
    for (const std::string& layer : {std::string("../a.usda"), std::string(), longName}) {
        state.layer = {layer};
        EXPECT_FALSE(layerStateOf(LayerStateOut(state).sample));
    }
    state = someState();
    state.editors.push_back({longName});
    EXPECT_FALSE(layerStateOf(LayerStateOut(state).sample));
    state = someState();
    state.holder = {longName};
    EXPECT_FALSE(layerStateOf(LayerStateOut(state).sample));

    Presence presence = somePresence();
    presence.camera.resize(15);
    EXPECT_FALSE(presenceOf(PresenceOut(presence).sample));
    presence.camera.assign(16, std::nan(""));
    EXPECT_FALSE(presenceOf(PresenceOut(presence).sample));
    presence = somePresence();
    presence.time = INFINITY;
    EXPECT_FALSE(presenceOf(PresenceOut(presence).sample));
    presence = somePresence();
    presence.data.assign(64 * 1024 + 1, ' ');
    EXPECT_FALSE(presenceOf(PresenceOut(presence).sample));
}
