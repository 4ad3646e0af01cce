#pragma once

#include <map>
#include <optional>

#include "usdlive/client/transport/CommitOrder.h"
#include "usdlive/common/protocol/Control.h"

namespace usdlive::client {

/// What a server tells once for all, until its session may hear of it (rules DD11, DD12). Without
/// I/O; one thread.
class NewsOrder {
public:
    /// More than these are not taken: a project has fewer, and the server says so.
    static constexpr std::size_t kMostLayers = 100'000, kMostPeople = 10'000;

    // --- As it comes, in any order, any number of times.
    void state(std::uint64_t number, Revision afterCommit, LayerState state);
    void presence(std::uint64_t number, Presence presence, dds::TimePoint now);
    void gone(const ClientId& client);

    // --- What the session's own stream says.
    /// It was told all states below this number.
    void statesFrom(std::uint64_t number);
    /// It was told all presences below this number, which are `first`.
    void presencesFrom(std::uint64_t number, const Presences& first, dds::TimePoint now);

    // --- What is for the session now.
    /// LS1: none before the commit it is of.
    [[nodiscard]] LayerStates takeStates(const CommitOrder& commits);
    /// PS2: who is not heard of any more is gone.
    [[nodiscard]] Presences takePresences(dds::TimePoint now);
    /// When takePresences() has something again, if nothing comes.
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
        dds::TimePoint heard;
    };

    /// Numbers below are known from the stream; 0: the session is not told yet.
    std::uint64_t statesFrom_ = 0, presencesFrom_ = 0;
    std::map<LayerId, Layer> layers_;
    std::size_t waitingStates_ = 0;
    std::map<ClientId, Person> people_;
    std::vector<ClientId> gone_;
    dds::TimePoint looked_{};
};

}  // namespace usdlive::client
