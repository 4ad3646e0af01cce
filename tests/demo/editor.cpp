// The demo's editor in C++: `demo_editor URL OUTPUT`. It keys the humanoid sample by sample at 60
// frames a second until it reads `finish`; otherwise it behaves like editor.py.

#include <poll.h>
#include <pxr/usd/sdf/attributeSpec.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/primSpec.h>
#include <pxr/usd/sdf/propertySpec.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <deque>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <string>
#include <thread>
#include <vector>

#include "usdlive/client/usd/Client.h"

using namespace usdlive;
using Clock = std::chrono::steady_clock;

namespace {

double millisecondsSince(Clock::time_point begin) {
    return std::chrono::duration<double, std::milli>(Clock::now() - begin).count();
}

std::string readWord() {
    pollfd input{STDIN_FILENO, POLLIN, 0};
    std::string word;
    if (poll(&input, 1, 0) > 0) std::getline(std::cin, word);
    return word;
}

struct Report {
    std::size_t edits = 0, lost = 0;
    std::deque<Clock::time_point> sent;
    std::vector<double> latencies;
    bool finished = false;

    double percentile(double share) {
        if (latencies.empty()) return 0;
        std::sort(latencies.begin(), latencies.end());
        return latencies[std::min(latencies.size() - 1,
                                  std::size_t(share * double(latencies.size())))];
    }

    void print(const Client& client) {
        std::cout << "{\"edits\":" << edits << ",\"lost\":" << lost
                  << ",\"p50\":" << percentile(0.5) << ",\"p99\":" << percentile(0.99)
                  << ",\"revision\":" << client.revision()
                  << ",\"pending\":" << client.pendingTransactions()
                  << ",\"connected\":" << (client.isConnected() ? "true" : "false")
                  << ",\"finished\":" << (finished ? "true" : "false") << "}" << std::endl;
    }
};

/// Writes one sample of a turning joint to the layer; the stages of the other editors show the
/// motion.
void key(const pxr::SdfLayerHandle& anim, int frame) {
    const pxr::SdfPath path("/Shot/Cast/Humanoid.userProperties:turn");
    if (!anim->GetPropertyAtPath(path)) {
        pxr::SdfJustCreatePrimAttributeInLayer(anim, path, pxr::SdfValueTypeNames->Double,
                                               pxr::SdfVariabilityVarying, true);
    }
    anim->SetTimeSample(path, double(frame % 240 + 1), std::sin(frame / 24.0) * 90.0);
}

}  // namespace

int main(int count, char** arguments) {
    if (count != 3) {
        std::cerr << "usage: demo_editor URL OUTPUT\n";
        return 2;
    }
    auto connected = Client::connect(
        arguments[1], {.user = "cpp", .application = "usdlive demo", .cacheFolder = {}});
    if (!connected) {
        std::cerr << connected.error().message << "\n";
        return 1;
    }
    Client& client = **connected;
    const auto root = client.openLayer(LayerId{"shot.usda"});
    if (!root) {
        std::cerr << root.error().message << "\n";
        return 1;
    }
    const std::vector<std::string> names{"shot.usda", "layout.usda", "anim.usda", "look.usda"};
    const auto layer = [&](const std::string& name) {
        return pxr::SdfLayer::Find((client.cacheFolder() / name).string());
    };

    Report report;
    client.setEventHandler([&](const client::Event& event) {
        if (const auto* commit = std::get_if<client::event::Committed>(&event)) {
            if (commit->commit.id.client != client.id() || report.sent.empty()) return;
            report.latencies.push_back(millisecondsSince(report.sent.front()));
            report.sent.pop_front();
        } else if (std::holds_alternative<client::event::Lost>(event)) {
            ++report.lost;
        }
    });

    bool working = true;
    int frame = 0;
    for (std::string word; word != "export"; word = readWord()) {
        const auto begin = Clock::now();
        if (word == "finish") {
            working = false;
            report.finished = client.flush(30'000);
        }
        if (working) {
            key(layer("anim.usda"), frame);
            ++report.edits;
            report.sent.push_back(begin);
        }
        client.tick();
        if (++frame % 6 == 0) report.print(client);
        std::this_thread::sleep_until(begin + std::chrono::microseconds(16'667));
    }

    std::filesystem::create_directories(arguments[2]);
    for (const std::string& name : names) {
        std::string text;
        layer(name)->ExportToString(&text);
        std::ofstream(std::filesystem::path(arguments[2]) / (name + ".txt")) << text;
    }
    report.print(client);
}
