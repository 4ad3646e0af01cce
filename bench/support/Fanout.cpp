// Runs the measurements of `fanout` and `saturate`, and prints them.
#include "Fanout.h"

#include <fcntl.h>
#include <unistd.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <optional>
#include <random>
#include <stdexcept>

#include "Broadcaster.h"
#include "DdsLoad.h"
#include "Figures.h"
#include "LiveClient.h"
#include "Load.h"
#include "Server.h"

namespace usdlive::bench {

namespace {

/// Measures the time of appending and syncing half a KiB, in milliseconds.
std::vector<float> measureSyncs(const std::filesystem::path& folder) {
    constexpr int kSyncs = 200;
    const auto path = folder / "sync";
    const int file = ::open(path.c_str(), O_CREAT | O_WRONLY | O_APPEND, 0600);
    const std::vector<char> bytes(512);
    std::vector<float> times;
    for (int i = 0; i < kSyncs; ++i) {
        const auto begin = Clock::now();
        if (::write(file, bytes.data(), bytes.size()) < 0 || ::fdatasync(file) != 0)
            throw std::runtime_error("cannot sync " + path.string());
        times.push_back(static_cast<float>(millisecondsSince(begin)));
    }
    ::close(file);
    return times;
}

/// The settings of a DDS domain that only this run uses.
dds::DomainSettings ddsSettings() {
    dds::DomainSettings settings;
    settings.domain = std::random_device()() % 90;
    return settings;
}

void writeRules(const std::filesystem::path& folder, const std::string& whose) {
    if (whose == "none") return;
    if (whose != "others" && whose != "own")
        throw std::runtime_error("--rules is none of none, others, own: " + whose);
    constexpr int kRules = 20;
    auto rules = nlohmann::json::array();
    for (int rule = 0; rule < kRules; ++rule) {
        const std::string number = std::to_string(rule);
        rules.push_back({{"effect", "deny"}, {"paths", {"/Elsewhere" + number + "/**"}}});
        if (whose == "others") rules.back()["users"] = {"somebody" + number};
    }
    std::filesystem::create_directories(folder / ".usdlive");
    std::ofstream(folder / ".usdlive" / "access.json")
        << nlohmann::json{{"format", 1}, {"rules", rules}};
}

LoadFigures measureServer(const FanoutConfiguration& configuration, const LoadPlan& plan,
                          const Cores& cores, const std::filesystem::path& folder) {
    writeLayer(folder, configuration.fields);
    // Imports the layer first, so that the measured server finds it in its store.
    joinElsewhere(ServerProcess(folder, {"--min-free-mib=1"}, {}).url());
    writeRules(folder, configuration.rules);
    std::vector<std::string> options{
        "--flush-interval-ms=" + std::to_string(configuration.flushIntervalMs),
        "--durability=" + configuration.durability, "--min-free-mib=1"};
    const bool dds = configuration.transport == "dds";
    const auto settings = ddsSettings();
    if (dds) {
        options.push_back("--dds");
        options.push_back("--dds-domain=" + std::to_string(settings.domain));
    }
    LoadPlan load = plan;
    load.isEncrypted = configuration.transport == "tls";
    if (load.isEncrypted) options.insert(options.end(), {"--tls", "auto"});
    ServerProcess server(folder, options, cores.server);
    UsdliveDialect dialect(configuration.edits, configuration.fields,
                           configuration.compact && !dds);
    if (dds)
        return runDdsLoad(plan, dialect, settings, folder.filename().string(), server.process());
    return runLoad(load, dialect, server.port(), server.process());
}

/// ddsperf does not always print this figure.
nlohmann::ordered_json orNothing(double figure) {
    return figure > 0 ? nlohmann::ordered_json(figure) : nlohmann::ordered_json();
}

/// `log`: measures the ceiling that stores the messages before it sends them.
LoadFigures measureCeiling(const LoadFigures& real, const LoadPlan& plan, const Cores& cores,
                           const std::filesystem::path& folder, const std::filesystem::path& log) {
    const BroadcasterOptions options{folder / (log.empty() ? "ceiling-port" : "durable-port"),
                                     real.frameBytes, plan.window > 0, log};
    ChildProcess broadcaster(broadcasterCommand(options), cores.server);
    const std::uint16_t port = awaitPort(broadcaster, options.portFile);
    RelayDialect dialect(real.submissionBytes);
    return runLoad(plan, dialect, port, broadcaster);
}

}  // namespace

void measureFanout(const char* name, const FanoutConfiguration& configuration) {
    const Cores cores = shareCores();
    const TemporaryFolder folder;
    LoadPlan plan;
    plan.connections = configuration.clients;
    plan.window = configuration.window;
    plan.seconds = configuration.seconds;
    auto syncs = measureSyncs(folder.path());
    pinThisThread(cores.load);
    const LoadFigures real = measureServer(configuration, plan, cores, folder.path());
    const bool dds = configuration.transport == "dds";
    const LoadFigures ceiling = dds ? runDdsPerf(plan, real.frameBytes, ddsSettings(), cores.server)
                                    : measureCeiling(real, plan, cores, folder.path(), {});
    std::optional<LoadFigures> durable;
    if (!dds && plan.window == 0)
        durable = measureCeiling(real, plan, cores, folder.path(), folder.path() / "log");

    const auto cpuUs = [&](const LoadFigures& figures) {
        return figures.cpuSeconds * 1e6 / double(figures.delivered) / configuration.edits;
    };
    const auto perSecond = [&](const LoadFigures& figures) {
        return double(figures.delivered) * configuration.edits / figures.seconds;
    };
    nlohmann::ordered_json line{
        {"bench", name},
        {"transport", configuration.transport},
        {"rules", configuration.rules},
        {"clients", configuration.clients},
        {"edits", configuration.edits},
        {"deliveredPerSec", perSecond(real)},
        {"serverCpuUsPerDelivered", cpuUs(real)},
        {"p50Ms", real.p50Ms},
        {"p99Ms", real.p99Ms},
        {"ceilingServerCpuUsPerDelivered", cpuUs(ceiling)},
        {"ceilingP99Ms", orNothing(ceiling.p99Ms)},
        {"ceilingDeliveredPerSec", perSecond(ceiling)},
        {"durableCeilingServerCpuUsPerDelivered", orNothing(durable ? cpuUs(*durable) : 0)},
        {"durableCeilingP99Ms", orNothing(durable ? durable->p99Ms : 0)},
        {"syncP50Ms", percentile(syncs, 0.5)},
        {"syncP99Ms", percentile(syncs, 0.99)},
        {"frameBytes", real.frameBytes},
        {"durability", configuration.durability},
        {"flushIntervalMs", configuration.flushIntervalMs},
        {"fields", configuration.fields}};
    print(line.dump());
}

}  // namespace usdlive::bench
