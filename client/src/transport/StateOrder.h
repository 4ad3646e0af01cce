// Puts layer states and presences of the DDS topics in order with the session's own stream.
#pragma once

#include <map>
#include <optional>

#include "transport/CommitOrder.h"
#include "usdlive/common/protocol/Control.h"

namespace usdlive::client {

/// Holds back layer states and presences that a server sends once for all clients, until this
/// session may use them (rules DD11, DD12). No I/O; one thread.
class StateOrder {
public:
    /// Limits for layers and people. A project has fewer, so further samples are dropped.
    static constexpr std::size_t kMostLayers = 100'000, kMostPeople = 10'000;

    // --- Samples as they are received, in any order and any number of times.
    void state(std::uint64_t number, Revision afterCommit, LayerState state);
    void presence(std::uint64_t number, Presence presence, dds::TimePoint now);
    void gone(const ClientId& client);

    // --- Marks of the session's own stream.
    /// Call when the session has received all states below this number.
    void statesFrom(std::uint64_t number);
    /// Call when the session has received all presences below this number, which are `first`.
    void presencesFrom(std::uint64_t number, const Presences& first, dds::TimePoint now);

    // --- Results for the session.
    /// LS1: returns the states whose commits have been taken.
    [[nodiscard]] LayerStates takeStates(const CommitOrder& commits);
    /// PS2: returns changed presences. Presences that were not repeated in time have ended.
    [[nodiscard]] Presences takePresences(dds::TimePoint now);
    /// Returns the time when takePresences() has a result even if nothing is received.
    [[nodiscard]] std::optional<dds::TimePoint> deadline() const;

private:
    struct Layer {
        std::uint64_t number = 0;
        Revision afterCommit = 0;
        std::optional<LayerState> waiting;
    };
    struct Person {
        std::uint64_t number = 0;
        std::optional<Presence> waiting;
        dds::TimePoint lastReceived;
    };

    /// Lower numbers were received over the stream; 0: the session uses no samples yet.
    std::uint64_t statesFrom_ = 0, presencesFrom_ = 0;
    std::map<LayerId, Layer> layers_;
    std::size_t waitingStates_ = 0;
    std::map<ClientId, Person> people_;
    std::vector<ClientId> gone_;
    dds::TimePoint looked_{};
};

}  // namespace usdlive::client
