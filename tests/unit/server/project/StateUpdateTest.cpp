// Tests that states of many layers and presences of many users fit into messages.
// clients accept.
#include <gtest/gtest.h>

#include "project/ports/Outbox.h"
#include "usdlive/common/protocol/Frame.h"
#include "usdlive/common/protocol/ServerControl.h"

namespace usdlive::server {
namespace {

std::vector<ControlMessage> messagesOf(const StateUpdate& update) {
    std::vector<ControlMessage> messages;
    const SharedBytes encoded = encodeStateUpdate(update);
    const auto frames = splitMessage(*encoded);
    for (const ByteView bytes : *frames) {
        const auto frame = decodeFrame(bytes);
        const std::string& json = std::get<ControlFrame>(*frame).json;
        EXPECT_LE(json.size(), 2 * kUpdateBytes);
        messages.push_back(*decodeServerControl(json));
    }
    return messages;
}

TEST(StateUpdate, ManyStatesAreSeveralMessages) {
    LayerStates states;
    for (int number = 0; number < 20'000; ++number) {
        LayerState& state = states.layers.emplace_back();
        state.layer = {std::to_string(number) + std::string(300, 'n') + ".usda"};
        state.dirty = true;
    }
    LayerStates received;
    const auto messages = messagesOf(states);
    EXPECT_GT(messages.size(), 1u);
    for (const ControlMessage& message : messages)
        for (const LayerState& state : std::get<LayerStates>(message).layers)
            received.layers.push_back(state);
    EXPECT_EQ(received, states);
}

TEST(StateUpdate, ManyPresencesAreSeveralMessages) {
    Presences people;
    for (int number = 0; number < 200; ++number) {
        people.shown.emplace_back().client = {"client" + std::to_string(number)};
        people.shown.back().data = std::string(60'000, 'd');
        people.gone.push_back({"gone" + std::to_string(number)});
    }
    Presences received;
    for (const ControlMessage& message : messagesOf(people)) {
        const auto& part = std::get<Presences>(message);
        received.shown.insert(received.shown.end(), part.shown.begin(), part.shown.end());
        received.gone.insert(received.gone.end(), part.gone.begin(), part.gone.end());
    }
    EXPECT_EQ(received, people);
    EXPECT_EQ(encodeStateUpdate(Presences{}), nullptr);
    EXPECT_EQ(encodeStateUpdate(LayerStates{}), nullptr);
}

}  // namespace
}  // namespace usdlive::server
