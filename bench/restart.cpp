// Measures how long a project is unavailable after its server was killed.
//
//   --fields=100000
//
// Measures from the start of the new process until a fresh client has the layer. `listenMs` is the
// time until the server listens. The CPU times include all threads; a busy machine changes them
// little. The server is killed two seconds after the layer was imported.
#include <chrono>
#include <nlohmann/json.hpp>
#include <optional>
#include <thread>

#include "support/Figures.h"
#include "support/LiveClient.h"
#include "support/Server.h"

using namespace usdlive::bench;

namespace {

void measure(int fields) {
    const TemporaryFolder folder;
    writeLayer(folder.path(), fields);
    std::optional<ServerProcess> server;
    server.emplace(folder.path(), std::vector<std::string>{"--min-free-mib=1"}, std::vector<int>{});
    joinElsewhere(server->url());
    std::this_thread::sleep_for(std::chrono::seconds(2));
    server->process().kill();

    const auto begin = Clock::now();
    server.emplace(folder.path(), std::vector<std::string>{"--min-free-mib=1"}, std::vector<int>{});
    const double listenMs = millisecondsSince(begin);
    const double listenCpuMs = server->process().cpuSeconds() * 1000;
    const double clientCpu = ownCpuSeconds();
    LiveClient fresh(server->url());
    fresh.open();
    const double ms = millisecondsSince(begin);
    const double clientCpuMs = (ownCpuSeconds() - clientCpu) * 1000;
    const double serverCpuMs = server->process().cpuSeconds() * 1000;
    checkLayer(fresh.layer, fields);
    print(nlohmann::ordered_json{{"bench", "restart"},
                                 {"fields", fields},
                                 {"ms", ms},
                                 {"listenMs", listenMs},
                                 {"listenCpuMs", listenCpuMs},
                                 {"serverCpuMs", serverCpuMs},
                                 {"clientCpuMs", clientCpuMs}}
              .dump());
}

}  // namespace

int main(int argc, char** argv) {
    return runBench("restart", [&] {
        if (isJoin(argc, argv)) return runJoin(argv);
        Arguments arguments(argc, argv);
        const auto fields = arguments.numbers("--fields", {100'000});
        arguments.finish();
        loadUsd();
        for (const int count : fields) measure(count);
    });
}
