// The session protocol, checked state by state: no model of it, but client/session and
// server/project themselves, with everything around them that may go otherwise as a choice.
//   model [--scenario=NAME] [--states=N] [--more=N] [--play=NAME.ACTIONS]
//
// What is searched. Two clients (the real Session each, with an editor that has one layer), one
// server (the real Project, on a store that has a durable and a volatile part), and lines that keep
// the order of each direction and nothing else. All orders are visited, the shortest first, of:
// editors writing the edits of a script; each message arriving; a line breaking, with what was
// under way over it arriving late or never, and each end noticing when it does; connecting and
// resuming; commits becoming durable, one or several at a time; loads, reads and snapshots of the
// server's host being done; the server's process dying, with some of its last commits durable and
// untold and the others gone, and the next one taking over with a higher epoch; a disk that is full
// or fails and is opened anew; a layer closed and opened again; a disk that forgets commits.
// Scenario.cpp says what is written in which scenario, and how often each fault may happen: that is
// all that bounds a search, so a scenario is searched to its end unless --states says otherwise.
// --more adds to each bound that a scenario has: `./run soak model`.
//
// What holds in every state:
// - M10, SE2, SE3: what a client takes for committed is the durable log up to its revision, by the
//   chain hash; so it is never lost again, and all see one order.
// - M8: the confirmed layer of a client is what the log up to its revision gives.
// - M9: no transaction, and no single edit under whatever number, is in the log twice.
// - M12: each edit that an editor wrote is pending, committed, or was told to be lost, and what was
//   told to be lost is never in the log. So an epoch's end brings back what was not kept, no more.
// - M6, M7: the editor shows what the session's view says, and that is the confirmed layer when
//   nothing is pending: refused work is gone from it. (The session checks in each step that its
//   prediction is the one it would make anew.)
// - No session ends by a fault, no frame is refused, no assertion fails.
// And where nothing goes on by itself any more: both clients are online, at the newest commit, with
// nothing pending, and have the layer that the server has and has stored. A search that came to its
// end also knows that no run can go on for ever without faults, whatever its order.
//
// What is abstracted. Messages are the real bytes, but a tick follows each input at once (except in
// "ticks"), time stands still, lines have no bound, the host's jobs do not fail, and there are no
// gestures, big values, saves, logs or looks at history: tests/simulation has those. A state is
// told from another by the SHA-256 of all that decides its future (Digest.h). That this leaves
// nothing out is checked by sample, by repeating steps from states that are reached in two ways.
//
// That a search can fail is a test of its own: worlds with a flaw of ours, each of which breaks a
// rule.
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
// Of the states reached in two ways, every so manyth is compared.
constexpr std::size_t kCompareEach = 20;

using Number = unsigned long long;

bool isWanted(const Scenario& scenario) {
    return options.scenario.empty() || options.scenario == scenario.name;
}

// More of each fault that the scenario has.
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

// What happens, line by line, and where it ends. `each`: also all that is between.
std::string told(Model& model, const std::vector<Action>& actions, bool each) {
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

std::string told(Model& model, const Scenario& scenario, const Counterexample& found) {
    std::string text = scenario.name + ": " + found.rule + ". It takes\n" +
                       told(model, found.actions, false) + "step by step: " + program;
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
            std::fputs(told(model, unpacked(options.play), true).c_str(), stdout);
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
        if (found.counterexample) ADD_FAILURE() << told(model, scenario, *found.counterexample);
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
        std::printf("as it should: %s", told(model, scenario, *found.counterexample).c_str());
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
