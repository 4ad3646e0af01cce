// The machines of the model and their known states.
#pragma once

#include <concepts>
#include <cstdint>
#include <deque>
#include <exception>
#include <functional>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "Digest.h"

namespace usdlive::model {

using MessageId = std::uint32_t;

/// An input of a machine. It is small and comparable, so that it can name a step.
struct Input {
    enum Kind : std::uint8_t {
        Connect,
        Disconnect,
        Receive,  ///< `argument`: MessageId
        // Inputs of a client:
        Tick,
        Write,   ///< makes the next edit of its script
        Toggle,  ///< closes the layer, or opens it again
        // Inputs of the server:
        Flush,   ///< `argument`: how many commits become durable and are reported to the project
        Answer,  ///< `argument`: which of the host's jobs is finished
        Die,  ///< `argument`: how many commits become durable without a report; then a new process
              ///< starts
        DiskFull,
        DiskFails,  ///< `argument`: how many commits become durable all the same, without a report
        RollBack,   ///< the process dies and the newest durable commit is lost, too: the disk
                    ///< reported it falsely, or (`argument` 1) a copy of the store with a lower
                    ///< epoch was put in its place
    };
    static constexpr std::uint32_t kMaxArgument = (1u << 20) - 1;

    Kind kind{};
    std::uint8_t session = 0;
    std::uint32_t argument = 0;

    [[nodiscard]] std::uint32_t packed() const {
        return std::uint32_t(kind) << 28 | std::uint32_t(session) << 20 | argument;
    }
    static Input unpacked(std::uint32_t packed) {
        return {Kind(packed >> 28), std::uint8_t(packed >> 20), packed & kMaxArgument};
    }
};

/// An output of a machine.
struct Output {
    std::uint8_t session = 0;
    bool closes = false;  ///< the machine ends the session; otherwise the output is a message:
    MessageId message = 0;
    bool operator==(const Output&) const = default;
};

/// The messages of a whole search, by number.
class Messages {
public:
    MessageId number(const SharedBytes& message) {
        const auto [entry, added] =
            numbers_.try_emplace(std::string(asText(*message)), MessageId(messages_.size()));
        if (added) messages_.push_back(message);
        if (messages_.size() > Input::kMaxArgument) throw std::logic_error("too many messages");
        return entry->second;
    }
    [[nodiscard]] const SharedBytes& operator[](MessageId id) const { return messages_[id]; }

private:
    std::unordered_map<std::string, MessageId> numbers_;
    std::vector<SharedBytes> messages_;
};

/// The states of one machine and the steps between them, which are computed when they are first
/// asked for. A machine runs only to compute an unknown step; a search over several machines works
/// with numbers. To run a step, the explorer takes a machine that is in the state already, or
/// copies one from a state on the way, or, if it cannot be copied, creates a new one. It then
/// applies the inputs that first led to the state.
///
/// A Machine has apply(Input) -> std::vector<Output>, digest(Digest&) and a Summary summary().
template <class Machine>
class Explored {
public:
    using State = std::uint32_t;
    using Summary = typename Machine::Summary;
    struct Step {
        State next = 0;
        std::vector<Output> outputs;
        std::string fault;  ///< not empty: this machine alone breaks a rule
    };

    explicit Explored(std::function<std::unique_ptr<Machine>()> make) : make_(std::move(make)) {
        enter(make_(), 0, {});
    }

    [[nodiscard]] const Summary& summary(State state) const { return nodes_[state].summary; }

    const Step& step(State state, Input input) {
        const std::uint64_t key = std::uint64_t(state) << 32 | input.packed();
        const auto known = steps_.find(key);
        if (known != steps_.end()) return known->second;
        return steps_.emplace(key, run(state, input)).first->second;
    }

    /// Checks that digest() leaves out nothing that matters: every `each`th state that was reached
    /// in two ways must behave the same from both, in all known steps. Returns how many steps were
    /// compared; throws std::logic_error at a difference.
    std::size_t compareWays(std::size_t each) {
        std::size_t compared = 0;
        for (const auto& [key, known] : steps_) {
            const State state = State(key >> 32);
            if (state % each != 0 || !nodes_[state].other || !known.fault.empty()) continue;
            const auto& [parent, input] = *nodes_[state].other;
            auto machine = machineAt(parent);
            (void)machine->apply(input);
            const auto outputs = machine->apply(Input::unpacked(std::uint32_t(key)));
            if (outputs != known.outputs || find(*machine) != known.next)
                throw std::logic_error("state " + std::to_string(state) +
                                       " is two that digest() does not tell apart");
            ++compared;
        }
        return compared;
    }

private:
    struct Node {
        State parent = 0;
        Input input;
        Summary summary;
        std::optional<std::pair<State, Input>> other;  // another way to this state
    };
    // Keeps machines in the states that were reached last, and some others as starting points. A
    // machine that cannot be copied can take only one step.
    static constexpr State kMaxIdle = 10'000, kKeepEach = 8;

    Step run(State state, Input input) {
        std::unique_ptr<Machine> machine = machineAt(state);
        Step step;
        try {
            step.outputs = machine->apply(input);
            step.next = enter(std::move(machine), state, input);
        } catch (const std::exception& fault) {
            step.fault = fault.what();
        }
        return step;
    }

    std::unique_ptr<Machine> machineAt(State state) {
        std::vector<Input> way;
        std::unique_ptr<Machine> machine;
        for (State at = state; !machine; at = nodes_[at].parent) {
            machine = at == 0 ? make_() : idleAt(at, state);
            if (!machine) way.push_back(nodes_[at].input);
        }
        for (auto input = way.rbegin(); input != way.rend(); ++input) (void)machine->apply(*input);
        return machine;
    }

    std::unique_ptr<Machine> idleAt(State at, State wanted) {
        const auto idle = idle_.find(at);
        if (idle == idle_.end()) return nullptr;
        if constexpr (std::copy_constructible<Machine>)
            return std::make_unique<Machine>(*idle->second);
        else
            return at == wanted ? std::move(idle_.extract(idle).mapped()) : nullptr;
    }

    State enter(std::unique_ptr<Machine> machine, State from, Input input) {
        const auto [entry, added] = states_.try_emplace(digestOf(*machine), State(nodes_.size()));
        if (added)
            nodes_.push_back({from, input, machine->summary(), {}});
        else
            nodes_[entry->second].other = {from, input};
        if (added) keep(std::move(machine), entry->second);
        return entry->second;
    }

    void keep(std::unique_ptr<Machine> machine, State state) {
        idle_.emplace(state, std::move(machine));
        if (state >= kMaxIdle && state % kKeepEach != 0) idle_.erase(state - kMaxIdle);
    }

    static Hash digestOf(const Machine& machine) {
        Digest digest;
        machine.digest(digest);
        return sha256(asBytes(digest.text()));
    }
    [[nodiscard]] std::optional<State> find(const Machine& machine) const {
        const auto entry = states_.find(digestOf(machine));
        return entry == states_.end() ? std::nullopt : std::optional(entry->second);
    }

    const std::function<std::unique_ptr<Machine>()> make_;
    std::deque<Node> nodes_;
    std::unordered_map<Hash, State> states_;
    std::unordered_map<std::uint64_t, Step> steps_;
    std::unordered_map<State, std::unique_ptr<Machine>> idle_;
};

}  // namespace usdlive::model
