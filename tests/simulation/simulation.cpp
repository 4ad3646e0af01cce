// Runs many seeds of the simulation (see SimWorld.h). Prints for each failed seed the command that
// repeats it.
//   simulation [--seeds=N] [--first=S] [--seed=S] [--threads=T] [--verbose]
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <span>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "SimWorld.h"
#include "unit/Seeds.h"

namespace {

using usdlive::simulation::SimReport;

struct Options {
    std::uint64_t first = 1, seeds = 200;
    std::uint64_t threads = std::max(1u, std::thread::hardware_concurrency());
    bool verbose = false;
} options;
std::string program;

// Seeds are independent, so each free thread runs the next one.
class Campaign {
public:
    static constexpr std::uint64_t kEnoughFailures = 10;

    void run() {
        reports_.resize(options.seeds);
        std::vector<std::thread> threads;
        for (std::uint64_t index = 0; index < options.threads; ++index)
            threads.emplace_back([this] { work(); });
        for (std::thread& thread : threads) thread.join();
    }
    void report() {
        SimReport all;
        for (std::uint64_t index = 0; index < options.seeds; ++index) {
            const SimReport& one = reports_[index];
            all.commits += one.commits;
            all.lost += one.lost;
            all.restarts += one.restarts;
            all.snapshots += one.snapshots;
            all.unloads += one.unloads;
            all.accepted += one.accepted;
            all.together += one.together;
            all.compactions += one.compactions;
            all.previewedBlobs += one.previewedBlobs;
            all.collected += one.collected;
            all.forgotten += one.forgotten;
            all.inParts += one.inParts;
            all.writtenAgain += one.writtenAgain;
            all.moves += one.moves;
            all.movesOfSeveral += one.movesOfSeveral;
            all.refusedMoves += one.refusedMoves;
            all.writes += one.writes;
            all.carried += one.carried;
            all.otherHistories += one.otherHistories;
            all.joinsOfOther += one.joinsOfOther;
            all.regained += one.regained;
            all.policies += one.policies;
            all.forbidden += one.forbidden;
            all.undos += one.undos;
            all.redos += one.redos;
            all.kept += one.kept;
            all.undosChecked += one.undosChecked;
            all.reverted += one.reverted;
            all.stayed += one.stayed;
            if (options.verbose) print("seed " + std::to_string(options.first + index), one);
            if (!one.failure.empty())
                ADD_FAILURE() << "seed " << options.first + index << ": " << one.failure
                              << "repeat with: " << program << " --seed=" << options.first + index;
        }
        const std::chrono::duration<double> took = std::chrono::steady_clock::now() - start_;
        std::printf("%llu seeds in %.1f s, %.0f a second\n", number(played_), took.count(),
                    double(played_) / took.count());
        print("all", all);
        if (options.seeds < 100 || failures_ > 0) return;
        EXPECT_GT(all.movesOfSeveral, 0u);
        EXPECT_GT(all.refusedMoves, 0u);
        EXPECT_GT(all.carried, 0u);
        EXPECT_GT(all.joinsOfOther, 0u);
        EXPECT_GT(all.regained, 0u);
        EXPECT_GT(all.forbidden, 0u);
        EXPECT_GT(all.redos, 0u);
        EXPECT_GT(all.kept, 0u);
        EXPECT_GT(all.undosChecked, 0u);
        EXPECT_GT(all.reverted, 0u);
        EXPECT_GT(all.stayed, 0u);
    }

private:
    void work() {
        for (std::uint64_t index = next_++; index < options.seeds; index = next_++) {
            if (failures_ >= kEnoughFailures) return;
            reports_[index] = usdlive::simulation::play(options.first + index);
            ++played_;
            if (!reports_[index].failure.empty()) ++failures_;
        }
    }
    static unsigned long long number(std::uint64_t count) { return count; }
    static void print(const std::string& what, const SimReport& report) {
        std::printf(
            "%s: %llu commits, %llu edits lost, %llu restarts, %llu snapshots, %llu unloads, "
            "%llu accepted, %llu together, %llu compactions, %llu big values of previews, %llu "
            "collected, "
            "%llu clients forgotten, %llu in parts, %llu edits written again, "
            "%llu namespace edits (%llu of several layers, %llu refused), %llu writes to prims "
            "(%llu "
            "carried by moves), %llu other histories (joined %llu times, lacked %llu edits), "
            "%llu changes of rights (%llu transactions refused), "
            "%llu undos, %llu redos (kept %llu of others, %llu compared), %llu edits of reverts "
            "(%llu stayed)%s\n",
            what.c_str(), number(report.commits), number(report.lost), number(report.restarts),
            number(report.snapshots), number(report.unloads), number(report.accepted),
            number(report.together), number(report.compactions), number(report.previewedBlobs),
            number(report.collected), number(report.forgotten), number(report.inParts),
            number(report.writtenAgain), number(report.moves), number(report.movesOfSeveral),
            number(report.refusedMoves), number(report.writes), number(report.carried),
            number(report.otherHistories), number(report.joinsOfOther), number(report.regained),
            number(report.policies), number(report.forbidden), number(report.undos),
            number(report.redos), number(report.kept), number(report.undosChecked),
            number(report.reverted), number(report.stayed),
            report.failure.empty() ? "" : ", FAILED");
    }

    const std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
    std::vector<SimReport> reports_;
    std::atomic<std::uint64_t> next_ = 0, played_ = 0, failures_ = 0;
};

bool take(std::string_view argument, std::string_view name, std::uint64_t& number) {
    if (!argument.starts_with(name)) return false;
    number = std::strtoull(argument.substr(name.size()).data(), nullptr, 10);
    return true;
}

}  // namespace

// M8, M9, M12: after any events, all replicas end with the same content, every transaction is in
// the log at most once, and its author is notified of every edit that is not.
TEST(Simulation, EverySeedConverges) {
    Campaign campaign;
    campaign.run();
    campaign.report();
}

// Faults that these seeds found in usdlive now have their own tests: ED7 (8733), M14 (9997,
// 204817), B6 (10921), work that was lost with a layer that could not be read (412441), M9 after a
// transaction was sent again (500802, 516254), a repair after a preview that hid the rest (505224),
// CF1 (514812), DD5 before a hold (6330, 12778), a failed join that was not read before the
// connection was lost (4788), an editor that joins another history of a server that has forgotten
// its transactions (2185), how places follow (M15: 3217, 3258, 8430, 8496, 10979, 22185,
// 26034, 31181, 33250, 60341), M16 in a prediction that has moved the named spec (1605), values of
// others that were carried to another history (11267), a transaction that was sent again in a
// shorter history (65601), an editor of another history that resumes where the base will be (ID2:
// 71535). The other seeds found faults of the simulation.
TEST(Simulation, SeedsThatFailedOnceConverge) {
    if (options.seeds == 1) GTEST_SKIP() << "another seed was requested";
    constexpr std::array seeds{1605,   3217,   3258,   31181,  33250,  60341, 2185,  3263,   4788,
                               6330,   8430,   8496,   8733,   8922,   9997,  10921, 10979,  11267,
                               12778,  17210,  18278,  22185,  26034,  65601, 71535, 204817, 412441,
                               500802, 505224, 514812, 516254, 706356, 905787};
    for (const std::uint64_t seed : std::span(seeds).first(usdlive::seedsOf(seeds.size())))
        EXPECT_EQ(usdlive::simulation::play(seed).failure, "") << "seed " << seed;
}

int main(int count, char** arguments) {
    testing::InitGoogleTest(&count, arguments);
    program = arguments[0];
    for (int index = 1; index < count; ++index) {
        const std::string_view argument = arguments[index];
        std::uint64_t seed = 0;
        if (argument == "--verbose") {
            options.verbose = true;
        } else if (take(argument, "--seed=", seed)) {
            options.first = seed;
            options.seeds = 1;
            options.verbose = true;
        } else if (!take(argument, "--seeds=", options.seeds) &&
                   !take(argument, "--first=", options.first) &&
                   !take(argument, "--threads=", options.threads)) {
            std::fprintf(
                stderr,
                "simulation [--seeds=N] [--first=S] [--seed=S] [--threads=T] [--verbose]\n");
            return 2;
        }
    }
    return RUN_ALL_TESTS();
}
