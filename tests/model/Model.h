// The model: a server, clients, and the messages between them.
#pragma once

#include <array>
#include <compare>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "Explored.h"
#include "ModelClient.h"
#include "ModelServer.h"
#include "Scenario.h"
#include "simulation/SimClock.h"

namespace usdlive::model {

/// Thrown when a state or a step breaks a rule.
using Violation = simulation::SimFailure;

/// A possible next step.
struct Action {
    enum Kind : std::uint8_t {
        // Steps that happen without a decision:
        ToClient,  ///< `argument`: which of the messages on their way
        ToServer,
        ToServerLate,   ///< over a connection that the client has closed; `argument`: which one
        ServerNotices,  ///< the server notices that such a connection is dead
        ClientNotices,  ///< the client notices that its connection is dead
        Connect,
        Tick,
        Flush,
        Answer,
        // Decisions of users, and faults; their number is bounded:
        Write,
        Toggle,
        Break,
        Die,
        DiskFull,
        DiskFails,
        RollBack,
    };
    Kind kind{};
    std::uint8_t client = 0;
    std::uint16_t argument = 0;

    [[nodiscard]] bool isProgress() const { return kind < Write; }
    [[nodiscard]] std::uint32_t packed() const {
        return std::uint32_t(kind) << 24 | std::uint32_t(client) << 16 | argument;
    }
    static Action unpacked(std::uint32_t packed) {
        return {Kind(packed >> 24), std::uint8_t(packed >> 16), std::uint16_t(packed)};
    }
};

/// All machines and the connections between them at one moment, as numbers of states that are
/// stored once.
struct World {
    std::array<std::uint32_t, kClients> clients{};
    std::uint32_t server = 0;
    std::array<std::uint32_t, kClients> lines{};
    Bounds spent{};

    bool operator==(const World&) const = default;
};

/// The protocol as a graph of Worlds: the possible steps of each, their results, and the rules that
/// hold in each.
class Model {
public:
    explicit Model(const Scenario& scenario);

    [[nodiscard]] World start();
    [[nodiscard]] std::vector<Action> actions(const World& world);
    /// Returns the world after the action. Throws Violation.
    [[nodiscard]] World after(World world, Action action);
    /// Throws Violation if a rule is broken. `quiet`: no step happens without a decision any more.
    void check(const World& world, bool quiet) const;

    [[nodiscard]] std::string describe(const World& before, Action action);
    [[nodiscard]] std::string describe(const World& world) const;
    /// See Explored::compareWays().
    std::size_t compareWays(std::size_t each);

private:
    using Queue = std::vector<MessageId>;
    /// A connection that the client has closed; messages that it had sent may still arrive.
    struct Late {
        std::uint8_t session = 0;
        Queue toServer;
        auto operator<=>(const Late&) const = default;
    };
    struct Line {
        // From the client's point of view.
        enum State : std::uint8_t { Down, Up, Dead } state = Down;
        std::uint8_t session = 0;
        Queue toServer, toClient;
        std::vector<Late> late;
        auto operator<=>(const Line&) const = default;
    };

    [[nodiscard]] const Line& lineOf(const World& world, std::size_t client) const {
        return *lines_[world.lines[client]];
    }
    void setLine(World& world, std::size_t client, Line line);
    void stepClient(World& world, std::size_t client, Input input);
    void stepServer(World& world, Input input);
    void serverDied(World& world);
    void act(World& world, Action action, Line line);
    [[nodiscard]] bool changes(const World& world, std::size_t client, Input::Kind kind);
    void addActionsOf(std::vector<Action>& actions, const World& world, std::uint8_t client);
    void addActionsOfServer(std::vector<Action>& actions, const World& world) const;
    void checkClient(const ModelClient::Summary& client, const History& history) const;
    [[nodiscard]] std::string describe(MessageId message) const;

    const Scenario& scenario_;
    Messages messages_;
    Archive archive_;
    std::array<Explored<ModelClient>, kClients> clients_;
    Explored<ModelServer> server_;
    std::map<Line, std::uint32_t> lineNumbers_;
    std::vector<const Line*> lines_;
};

}  // namespace usdlive::model
