// Joins a served layer as a client.
#include "LiveClient.h"

#include <chrono>
#include <stdexcept>
#include <string_view>
#include <thread>

#include "ChildProcess.h"
#include "Server.h"

namespace usdlive::bench {

namespace {

constexpr std::string_view kVerb = "--join";

template <class T>
T orThrow(Result<T> result) {
    if (!result) throw std::runtime_error(result.error().message);
    return std::move(*result);
}

}  // namespace

LiveClient::LiveClient(const std::string& url) {
    Client::Options options;
    options.user = options.application = "bench";
    client = orThrow(Client::connect(url, options));
}

void LiveClient::open() { layer = orThrow(client->openLayer(kLayer)); }

void checkLayer(const pxr::SdfLayerHandle& layer, int fields) {
    const pxr::SdfPath last(attributePath(fields - 1));
    if (!layer || !layer->HasField(last, pxr::SdfFieldKeys->Default))
        throw std::runtime_error("the layer is incomplete");
}

void joinElsewhere(const std::string& url) {
    // While the server imports a huge layer, a client may treat it as dead and reconnect.
    constexpr int kAttempts = 10;
    for (int i = 0; i < kAttempts; ++i) {
        ChildProcess other({"/proc/self/exe", std::string(kVerb), url}, {});
        while (other.isRunning()) std::this_thread::sleep_for(std::chrono::milliseconds(10));
        if (other.succeeded()) return;
    }
    throw std::runtime_error("cannot join the layer");
}

bool isJoin(int argc, char** argv) { return argc == 3 && argv[1] == kVerb; }

void runJoin(char** argv) {
    LiveClient other(argv[2]);
    other.open();
}

void loadUsd() {
    const auto layer = pxr::SdfLayer::CreateAnonymous(".usda");
    layer->ImportFromString("#usda 1.0\ndef Scope \"World\"\n{\n    double3 a = (0, 0, 0)\n}\n");
}

}  // namespace usdlive::bench
