// What does a project of a studio's size cost who opens a little of it?
//
//   --layers=50000  --open=2000
//
// So many layers, in folders of a hundred; a root layer has `open` of them as references and the
// rest as payloads. `listenMs`: from the start of the server's process until it listens.
// `connectMs`: a connect to a fresh cache folder, and how long until every layer has its
// placeholder. `openMs`: the root and what it brings in. The ticks are of an idle client, 300
// of them, one a millisecond: the median and the 99th percentile.
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
    while (!fs::exists(last)) std::this_thread::sleep_for(std::chrono::milliseconds(5));
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
                                 {"idleTickMs", connected.median},
                                 {"slowIdleTickMs", connected.slow},
                                 {"openMs", openMs},
                                 {"openIdleTickMs", opened.median},
                                 {"openSlowIdleTickMs", opened.slow}}
              .dump());
}

}  // namespace

int main(int argc, char** argv) {
    return runBench("studio", [&] {
        Arguments arguments(argc, argv);
        const int layers = arguments.number("--layers", 50'000);
        const int open = arguments.number("--open", 2'000);
        arguments.finish();
        loadUsd();
        measure(layers, open);
    });
}
