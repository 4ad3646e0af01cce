// Measures an editor's cost of coming back with work that was made without a connection.
//
//   --pending=1000,10000,100000,1000000  --attributes=10000  --budget=4
//
// A client's server is killed. The client edits `pending` frames, one attribute in each, and ticks
// after each. The server is started again. `longestTickMs` is the longest of all tick(budget) from
// then on until everything is committed; `longestTickCpuMs` is the same in CPU time of the thread
// (for a machine with other work). `totalMs` is the whole time, `cpuMs` this process's CPU time of
// it. The memory is the client's when it begins to send.
#include <pxr/base/gf/vec3d.h>
#include <pxr/usd/sdf/path.h>
#include <sys/resource.h>

#include <algorithm>
#include <chrono>
#include <ctime>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>
#include <thread>
#include <vector>

#include "support/Figures.h"
#include "support/LiveClient.h"
#include "support/Server.h"

using namespace usdlive::bench;

namespace {

double ownCpuMs() {
    rusage used{};
    getrusage(RUSAGE_SELF, &used);
    const auto ms = [](const timeval& time) {
        return double(time.tv_sec) * 1e3 + double(time.tv_usec) / 1e3;
    };
    return ms(used.ru_utime) + ms(used.ru_stime);
}

double threadCpuMs() {
    timespec now{};
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return double(now.tv_sec) * 1e3 + double(now.tv_nsec) / 1e6;
}

struct Longest {
    double ms = 0, cpuMs = 0;
};

double peakMib() {
    rusage used{};
    getrusage(RUSAGE_SELF, &used);
    return double(used.ru_maxrss) / 1024;
}

// Ticks until `done`. Returns the longest tick.
template <class Done>
Longest tickUntil(LiveClient& editor, double budgetMs, const Done& done) {
    Longest longest;
    const auto begin = Clock::now();
    while (!done()) {
        const auto tick = Clock::now();
        const double cpu = threadCpuMs();
        const bool more = editor.client->tick(budgetMs).more;
        longest.ms = std::max(longest.ms, millisecondsSince(tick));
        longest.cpuMs = std::max(longest.cpuMs, threadCpuMs() - cpu);
        if (!more) std::this_thread::sleep_for(std::chrono::milliseconds(1));
        if (millisecondsSince(begin) > 1'800'000) throw std::runtime_error("it takes too long");
    }
    return longest;
}

void measure(int pending, int attributes, double budgetMs) {
    const TemporaryFolder folder;
    writeLayer(folder.path(), attributes);
    std::optional<ServerProcess> server;
    server.emplace(folder.path(), std::vector<std::string>{"--min-free-mib=1"}, std::vector<int>{});
    LiveClient editor(server->url());
    editor.open();
    const std::uint16_t port = server->port();
    server->process().kill();
    tickUntil(editor, budgetMs, [&] { return !editor.client->isConnected(); });

    std::vector<pxr::SdfPath> paths;
    for (int i = 0; i < attributes; ++i) paths.emplace_back(attributePath(i));
    for (int i = 0; i < pending; ++i) {
        editor.layer->SetField(paths[std::size_t(i % attributes)], pxr::SdfFieldKeys->Default,
                               pxr::VtValue(pxr::GfVec3d(i, 1, 0.25)));
        editor.client->tick(budgetMs);
    }
    if (editor.client->pendingTransactions() != std::size_t(pending))
        throw std::runtime_error("the edits are not pending");

    server.emplace(folder.path(), std::vector<std::string>{"--min-free-mib=1"}, std::vector<int>{},
                   port);
    const double mib = peakMib();
    const double cpu = ownCpuMs();
    const auto begin = Clock::now();
    const Longest longest = tickUntil(editor, budgetMs, [&] {
        return editor.client->isConnected() && editor.client->pendingTransactions() == 0;
    });
    const double total = millisecondsSince(begin);
    print(nlohmann::ordered_json{
        {"bench", "resume"},
        {"pending", pending},
        {"longestTickMs", longest.ms},
        {"longestTickCpuMs", longest.cpuMs},
        {"totalMs", total},
        {"usPerEdit", total * 1000 / pending},
        {"cpuMs", ownCpuMs() - cpu},
        {"peakMib",
         mib}}.dump());
}

}  // namespace

int main(int argc, char** argv) {
    return runBench("resume", [&] {
        Arguments arguments(argc, argv);
        const auto counts = arguments.numbers("--pending", {1'000, 10'000, 100'000, 1'000'000});
        const int attributes = arguments.number("--attributes", 10'000);
        const int budget = arguments.number("--budget", 4);
        arguments.finish();
        loadUsd();
        for (const int pending : counts) measure(pending, attributes, budget);
    });
}
