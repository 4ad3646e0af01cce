// Holds back samples of layer states and presences until the session may use them.
#include "transport/StateOrder.h"

#include <algorithm>
#include <utility>

namespace usdlive::client {

namespace {

constexpr std::chrono::milliseconds kPresenceTime{kPresenceTimeMs};

}  // namespace

void StateOrder::state(std::uint64_t number, Revision afterCommit, LayerState state) {
    const auto known = layers_.find(state.layer);
    if (known == layers_.end() && layers_.size() >= kMostLayers) return;
    Layer& layer = known == layers_.end() ? layers_[state.layer] : known->second;
    if (number <= layer.number || number < statesFrom_) return;
    waitingStates_ += layer.waiting ? 0 : 1;
    layer = {number, afterCommit, std::move(state)};
}

void StateOrder::statesFrom(std::uint64_t number) {
    statesFrom_ = number;
    for (auto& [id, layer] : layers_)
        if (layer.number < number && std::exchange(layer.waiting, std::nullopt)) --waitingStates_;
}

LayerStates StateOrder::takeStates(const CommitOrder& commits) {
    LayerStates ready;
    if (statesFrom_ == 0 || waitingStates_ == 0) return ready;
    for (auto& [id, layer] : layers_) {
        if (!layer.waiting || !commits.hasReached(layer.afterCommit)) continue;
        ready.layers.push_back(std::move(*layer.waiting));
        layer.waiting.reset();
        --waitingStates_;
    }
    return ready;
}

void StateOrder::presence(std::uint64_t number, Presence presence, dds::TimePoint now) {
    const auto known = people_.find(presence.client);
    if (known == people_.end() && people_.size() >= kMostPeople) return;
    Person& person = known == people_.end() ? people_[presence.client] : known->second;
    person.lastReceived = now;
    if (number <= person.number) return;
    person.number = number;
    person.waiting = std::move(presence);
}

void StateOrder::gone(const ClientId& client) {
    if (people_.erase(client) > 0 && presencesFrom_ != 0) gone_.push_back(client);
}

void StateOrder::presencesFrom(std::uint64_t number, const Presences& first, dds::TimePoint now) {
    presencesFrom_ = number;
    std::erase_if(people_, [&](const auto& entry) { return entry.second.number < number; });
    for (const Presence& shown : first.shown)
        people_.try_emplace(shown.client, Person{number - 1, std::nullopt, now});
    looked_ = now;
}

Presences StateOrder::takePresences(dds::TimePoint now) {
    Presences ready;
    if (presencesFrom_ == 0) return ready;
    // After a pause of this process the times start again, because the users were not silent.
    if (now - std::exchange(looked_, now) >= kPresenceTime)
        for (auto& [client, person] : people_) person.lastReceived = now;
    for (auto entry = people_.begin(); entry != people_.end();) {
        Person& person = entry->second;
        if (now - person.lastReceived >= kPresenceTime) {
            gone_.push_back(entry->first);
            entry = people_.erase(entry);
            continue;
        }
        if (person.waiting) ready.shown.push_back(std::move(*person.waiting));
        person.waiting.reset();
        ++entry;
    }
    ready.gone = std::exchange(gone_, {});
    return ready;
}

std::optional<dds::TimePoint> StateOrder::deadline() const {
    std::optional<dds::TimePoint> earliest;
    if (presencesFrom_ == 0) return earliest;
    for (const auto& [client, person] : people_) {
        const dds::TimePoint due = person.lastReceived + kPresenceTime;
        earliest = earliest ? std::min(*earliest, due) : due;
    }
    return earliest;
}

}  // namespace usdlive::client
