// Measures the cost of a project of a studio's size for a client that opens a small part of it.
//
//   --layers=50000  --open=2000
//
// Creates `layers` layers, in folders of a hundred; a root layer has `open` of them as references
// and the rest as payloads. `listenMs`: from the start of the server's process until it listens.
// `connectMs`: a connect with a fresh cache folder, and the time until every layer has its
// placeholder; `longestTickMs`: the longest of the ticks until then, one every 2 ms. `openMs`:
// opening the root and the layers that it uses. The idle ticks are 300, one a millisecond: the
// median and the 99th percentile.
//
//   --big=100  --mib=10
//
// Measures the server's memory for layers that nobody has open any more. One client after the other
// opens and closes `big` layers with `mib` of text each, of attributes with a double3.
// `serverPeakMiB` and `serverMiB`: the server's memory at its peak, and at the end. `openMs`: the
// median time to open one, with the import.
#include <chrono>
#include <fstream>
#include <nlohmann/json.hpp>
#include <thread>
#include <vector>

#include "support/Figures.h"
#include "support/LiveClient.h"
#include "support/Server.h"

using namespace usdlive::bench;

namespace {

namespace fs = std::filesystem;

std::string nameOf(int layer) {
    return "f" + std::to_string(layer / 100) + "/l" + std::to_string(layer) + ".usda";
}

void writeProject(const fs::path& folder, int layers, int open) {
    std::ofstream root(folder / kLayer.value);
    root << "#usda 1.0\n";
    for (int layer = 0; layer < layers; ++layer) {
        if (layer % 100 == 0) fs::create_directories((folder / nameOf(layer)).parent_path());
        std::ofstream(folder / nameOf(layer))
            << "#usda 1.0\n(\n    defaultPrim = \"P\"\n)\ndef \"P\"\n{\n}\n";
        root << "def \"p" << layer << "\" (" << (layer < open ? "references" : "payload")
             << " = @./" << nameOf(layer) << "@)\n{\n}\n";
    }
}

struct Ticks {
    double median = 0, slow = 0;
};
Ticks idleTicks(LiveClient& client) {
    std::vector<float> ticks;
    for (int i = 0; i < 500; ++i)
        client.client->tick(), std::this_thread::sleep_for(std::chrono::milliseconds(2));
    for (int i = 0; i < 300; ++i) {
        const auto begin = Clock::now();
        client.client->tick();
        ticks.push_back(float(millisecondsSince(begin)));
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    return {percentile(ticks, 0.5), percentile(ticks, 0.99)};
}

void measure(int layers, int open) {
    const TemporaryFolder folder;
    writeProject(folder.path(), layers, open);
    auto begin = Clock::now();
    const ServerProcess server(folder.path(), {"--min-free-mib=1"}, {});
    const double listenMs = millisecondsSince(begin);

    begin = Clock::now();
    LiveClient client(server.url());
    const double connectMs = millisecondsSince(begin);
    const fs::path last = client.client->cacheFolder() / nameOf(layers - 1);
    double longestTickMs = 0;
    while (!fs::exists(last)) {
        const auto tick = Clock::now();
        client.client->tick();
        longestTickMs = std::max(longestTickMs, millisecondsSince(tick));
        std::this_thread::sleep_for(std::chrono::milliseconds(2));
    }
    const double placeholdersMs = millisecondsSince(begin);
    const Ticks connected = idleTicks(client);

    begin = Clock::now();
    client.layer = client.client->openLayer(kLayer, usdlive::client::LoadSet::NoPayloads).value();
    const double openMs = millisecondsSince(begin);
    const Ticks opened = idleTicks(client);
    print(nlohmann::ordered_json{{"bench", "studio"},
                                 {"layers", layers},
                                 {"open", open},
                                 {"listenMs", listenMs},
                                 {"connectMs", connectMs},
                                 {"placeholdersMs", placeholdersMs},
                                 {"longestTickMs", longestTickMs},
                                 {"idleTickMs", connected.median},
                                 {"slowIdleTickMs", connected.slow},
                                 {"openMs", openMs},
                                 {"openIdleTickMs", opened.median},
                                 {"openSlowIdleTickMs", opened.slow}}
              .dump());
}

// Reads "VmHWM" or "VmRSS" from /proc/<pid>/status.
double memoryMib(pid_t process, const std::string& name) {
    std::ifstream status("/proc/" + std::to_string(process) + "/status");
    for (std::string line; std::getline(status, line);)
        if (line.starts_with(name + ":")) return std::stod(line.substr(name.size() + 1)) / 1024;
    throw std::runtime_error("cannot read the memory of the server from /proc");
}

void writeBig(const fs::path& file, int mib) {
    std::ofstream out(file);
    out << "#usda 1.0\ndef \"World\"\n{\n";
    for (int prim = 0; out.tellp() < std::streamoff(mib) << 20; ++prim) {
        out << "def \"p" << prim << "\"\n{\n";
        for (int attribute = 0; attribute < kAttributesPerPrim; ++attribute)
            out << "    custom double3 a" << attribute << " = (" << prim << ", " << attribute
                << ", 0.5)\n";
        out << "}\n";
    }
    out << "}\n";
}

void measureBig(int layers, int mib) {
    const TemporaryFolder folder;
    for (int layer = 0; layer < layers; ++layer)
        writeBig(folder.path() / ("l" + std::to_string(layer) + ".usda"), mib);
    ServerProcess server(folder.path(), {"--min-free-mib=1"}, {});
    LiveClient client(server.url());
    std::vector<float> opens;
    for (int layer = 0; layer < layers; ++layer) {
        const usdlive::LayerId id{"l" + std::to_string(layer) + ".usda"};
        const auto begin = Clock::now();
        const auto opened = client.client->openLayer(id);
        if (!opened) throw std::runtime_error(opened.error().message);
        opens.push_back(float(millisecondsSince(begin)));
        client.client->close(id);
        client.client->tick();
    }
    const pid_t process = server.process().pid();
    print(nlohmann::ordered_json{{"bench", "studio"},
                                 {"bigLayers", layers},
                                 {"mib", mib},
                                 {"openMs", percentile(opens, 0.5)},
                                 {"serverPeakMiB", memoryMib(process, "VmHWM")},
                                 {"serverMiB", memoryMib(process, "VmRSS")}}
              .dump());
}

}  // namespace

int main(int argc, char** argv) {
    return runBench("studio", [&] {
        Arguments arguments(argc, argv);
        const int layers = arguments.number("--layers", 50'000);
        const int open = arguments.number("--open", 2'000);
        const int big = arguments.number("--big", 100);
        const int mib = arguments.number("--mib", 10);
        arguments.finish();
        loadUsd();
        if (layers > 0) measure(layers, open);
        if (big > 0) measureBig(big, mib);
    });
}
