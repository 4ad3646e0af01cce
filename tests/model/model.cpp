// Checks the session protocol in all states that can be reached. There is no separate model of the
// protocol: the search runs client/session and server/project themselves. Everything around them
// that may happen differently is a choice of the search.
//   model [--scenario=NAME] [--states=N] [--more=N] [--play=NAME.ACTIONS]
//
// The search. There are two clients (the real Session each, with an editor that has one
// layer), one server (the real Project, on a store with a durable and a volatile part), and
// connections that keep the order of each direction and nothing else. The search visits all orders
// of these events, the shortest first:
// - editors make the edits of a script;
// - each message arrives;
// - a connection breaks, its messages on the way arrive late or never, and each end notices it;
// - clients connect and resume;
// - commits become durable, one or several at a time;
// - loads, reads and snapshots of the server's host are finished;
// - the server's process dies, with some of its last commits durable and not reported and the
//   others lost, and the next one starts with a higher epoch;
// - a disk is full or fails, and is opened again;
// - a layer is closed and opened again;
// - a disk forgets commits.
// Scenario.cpp lists the edits of each scenario, and how often each fault may happen. Nothing else
// bounds a search, so a scenario is searched to its end unless --states limits it. --more adds to
// each bound of a scenario: `./run soak model`.
//
// The rules in every state:
// - M10, SE2, SE3: by the chain hash, the commits that a client has received are the durable log
//   up to its revision. So they are never lost again, and all clients see one order.
// - M8: the confirmed layer of a client is the content of the log up to its revision.
// - M9: no transaction, and no single edit under any number, is in the log twice.
// - M12: each edit that an editor made is pending, committed, or reported as lost, and an edit that
//   was reported as lost is never in the log. So the end of an epoch returns exactly the edits that
//   were not kept.
// - M6, M7: the editor shows the session's view. Without pending work that is the confirmed layer:
//   refused work has disappeared. (In each step the session checks that its prediction equals a new
//   one.)
// - No session ends by a fault, no frame is refused, no assertion fails.
// When no step happens without a decision any more, both clients are online, at the newest commit,
// have nothing pending, and have the layer that the server has and has stored. A search that
// reached its end has also shown that without faults no run continues for ever, in any order.
//
// The limits. Messages are the real bytes. But a tick follows each input at once (except in
// "ticks"), time stands still, connections have no bound, the host's jobs do not fail, and there
// are no gestures, big values, saves, logs or reads of old revisions: tests/simulation has those.
// States are compared by the SHA-256 of everything that decides their future (Digest.h). The search
// checks by samples that this leaves nothing out: it repeats steps from states that were reached in
// two ways.
//
// A test of its own shows that a search can fail: it runs worlds with a flaw that breaks a rule.
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <string_view>
#include <vector>

#include "Search.h"

namespace {

using namespace usdlive::model;

struct Options {
    std::string scenario;  // empty: all
    std::string play;      // see packed()
    std::uint64_t states = 0xffff'fffe, more = 0;
} options;
std::string program;

constexpr std::uint64_t kEnoughStates = 1'000'000;
// Compares every 20th of the states that were reached in two ways.
constexpr std::size_t kCompareEach = 20;

using Number = unsigned long long;

bool isWanted(const Scenario& scenario) {
    return options.scenario.empty() || options.scenario == scenario.name;
}

// Adds to each fault that the scenario has.
Scenario enlarged(Scenario scenario) {
    Bounds& bounds = scenario.bounds;
    for (std::uint8_t* bound :
         {&bounds.breaks[0], &bounds.breaks[1], &bounds.toggles[0], &bounds.toggles[1],
          &bounds.deaths, &bounds.diskFulls, &bounds.diskFailures, &bounds.rollBacks})
        if (*bound > 0) *bound = std::uint8_t(*bound + options.more);
    return scenario;
}

Found run(Model& model, const Scenario& scenario) {
    const auto start = std::chrono::steady_clock::now();
    Found found = search(model, options.states);
    const std::chrono::duration<double> took = std::chrono::steady_clock::now() - start;
    std::printf("%-10s %9llu states%s, %9llu transitions, %5llu quiet, depth %2zu, %5.1f s\n",
                scenario.name.c_str(), Number(found.states), found.exhausted ? " (all)" : "",
                Number(found.transitions), Number(found.quiet), found.depth, took.count());
    std::fflush(stdout);
    return found;
}

// ---- counterexamples

std::string packed(const std::vector<Action>& actions) {
    std::string text;
    char number[16];
    for (const Action action : actions) {
        std::snprintf(number, sizeof number, ".%x", action.packed());
        text += number;
    }
    return text;
}

std::vector<Action> unpacked(std::string_view text) {
    std::vector<Action> actions;
    for (std::size_t at = text.find('.'); at != text.npos; at = text.find('.', at + 1))
        actions.push_back(
            Action::unpacked(std::uint32_t(std::strtoul(text.data() + at + 1, nullptr, 16))));
    return actions;
}

// Describes the actions line by line, and their end. `each`: also all states in between.
std::string described(Model& model, const std::vector<Action>& actions, bool each) {
    World world = model.start();
    std::string text;
    try {
        for (const Action action : actions) {
            if (each) text += model.describe(world);
            text += "- " + model.describe(world, action) + "\n";
            world = model.after(world, action);
            model.check(world, false);
        }
    } catch (const Violation& violation) {
        text += std::string(violation.what()) + "\n";
    }
    return text + model.describe(world);
}

std::string described(Model& model, const Scenario& scenario, const Counterexample& found) {
    std::string text = scenario.name + ": " + found.rule + ". It takes\n" +
                       described(model, found.actions, false) + "step by step: " + program;
    if (options.more > 0) text += " --more=" + std::to_string(options.more);
    return text + " --play=" + scenario.name + packed(found.actions) + "\n";
}

int play() {
    const std::string name = options.play.substr(0, options.play.find('.'));
    for (const auto* list : {&scenarios(), &flawedScenarios()})
        for (const Scenario& each : *list) {
            if (each.name != name) continue;
            const Scenario scenario = enlarged(each);
            Model model(scenario);
            std::fputs(described(model, unpacked(options.play), true).c_str(), stdout);
            return 0;
        }
    std::fprintf(stderr, "there is no scenario %s\n", name.c_str());
    return 2;
}

}  // namespace

TEST(Model, RulesHoldInEveryState) {
    std::uint64_t states = 0, transitions = 0;
    for (const Scenario& each : scenarios()) {
        if (!isWanted(each)) continue;
        const Scenario scenario = enlarged(each);
        Model model(scenario);
        const Found found = run(model, scenario);
        states += found.states;
        transitions += found.transitions;
        if (found.counterexample)
            ADD_FAILURE() << described(model, scenario, *found.counterexample);
        EXPECT_GT(model.compareWays(kCompareEach), 0u);
    }
    std::printf("all        %9llu states, %9llu transitions\n", Number(states),
                Number(transitions));
    if (options.scenario.empty()) {
        EXPECT_GE(states, kEnoughStates);
    }
}

TEST(Model, FlawsAreFound) {
    for (const Scenario& scenario : flawedScenarios()) {
        if (!isWanted(scenario)) continue;
        Model model(scenario);
        const Found found = run(model, scenario);
        ASSERT_TRUE(found.counterexample) << scenario.name;
        std::printf("as it should: %s", described(model, scenario, *found.counterexample).c_str());
    }
}

int main(int count, char** arguments) {
    testing::InitGoogleTest(&count, arguments);
    program = arguments[0];
    for (int index = 1; index < count; ++index) {
        const std::string_view argument = arguments[index];
        const auto take = [&](std::string_view name, auto& value) {
            if (!argument.starts_with(name)) return false;
            const std::string text(argument.substr(name.size()));
            if constexpr (std::is_same_v<decltype(value), std::string&>)
                value = text;
            else
                value = std::strtoull(text.c_str(), nullptr, 10);
            return true;
        };
        if (take("--scenario=", options.scenario) || take("--states=", options.states) ||
            take("--more=", options.more) || take("--play=", options.play))
            continue;
        std::fprintf(stderr,
                     "model [--scenario=NAME] [--states=N] [--more=N] [--play=NAME.ACTIONS]\n");
        return 2;
    }
    return options.play.empty() ? RUN_ALL_TESTS() : play();
}
