// Publishes layer states and presences to all clients over DDS.
#include "transport/DdsStatePublisher.h"

#include <chrono>
#include <utility>

namespace usdlive::server {

namespace {

constexpr std::chrono::milliseconds kRepeat{kPresenceRepeatMs};
constexpr std::chrono::milliseconds kPresenceTime{kPresenceTimeMs};

}  // namespace

DdsStatePublisher::DdsStatePublisher(const dds::Domain& domain, std::uint64_t server)
    : server_(server),
      states_(domain, dds::partitionOf(server)),
      presences_(domain, dds::partitionOf(server)) {}

void DdsStatePublisher::publish(const LayerStates& states, Revision afterCommit) {
    for (const LayerState& state : states.layers) {
        layers_.insert(state.layer);
        dds::LayerStateOut out(state);
        out.sample.server = server_;
        out.sample.number = ++last_;
        out.sample.afterCommit = afterCommit;
        // Cyclone DDS keeps the latest state of each layer and sends it again. It fails only
        // without memory.
        static_cast<void>(states_.write(out.sample));
    }
}

void DdsStatePublisher::publish(const Presences& presences, dds::TimePoint now) {
    for (const Presence& shown : presences.shown) {
        Person& person = people_[shown.client];
        person = {shown, ++last_, {}};
        write(person);
    }
    for (const ClientId& client : presences.gone) {
        const auto found = people_.find(client);
        if (found == people_.end()) continue;
        found->second.leftAt = now;
        write(found->second);
    }
}

void DdsStatePublisher::write(const Person& person) {
    dds::PresenceOut out(person.presence);
    out.sample.server = server_;
    out.sample.number = person.number;
    if (person.hasLeft()) return presences_.dispose(out.sample);
    static_cast<void>(presences_.write(out.sample));
}

void DdsStatePublisher::repeat(dds::TimePoint now) {
    if (now - repeated_ < kRepeat) return;
    repeated_ = now;
    for (auto entry = people_.begin(); entry != people_.end();) {
        const Person& person = entry->second;
        write(person);
        // After this time, a client that received none of the samples has noticed the silence.
        if (!person.hasLeft() || now - person.leftAt <= kPresenceTime) {
            ++entry;
            continue;
        }
        dds::PresenceOut out(person.presence);
        out.sample.server = server_;
        presences_.forget(out.sample);
        entry = people_.erase(entry);
    }
}

void DdsStatePublisher::clear() {
    for (const LayerId& layer : std::exchange(layers_, {})) {
        LayerState state;
        state.layer = layer;
        dds::LayerStateOut out(state);
        out.sample.server = server_;
        states_.dispose(out.sample);
    }
    Presences all;
    for (const auto& [client, person] : people_) all.gone.push_back(client);
    publish(all, std::chrono::steady_clock::now());
}

}  // namespace usdlive::server
