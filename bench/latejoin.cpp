// Measures how long a client that joins a large layer waits.
//
//   --fields=100000,1000000
//
// Measures from openLayer() of a fresh client over a real socket until the SdfLayer is filled. The
// ceiling sets the same specs and fields in a bare SdfData, with paths and values that are in
// memory already. `clientCpuMs` and `serverCpuMs` include all threads; a busy machine changes them
// little. `longestTickMs` is from another client, an editor of 60 frames a second that gives each
// tick 4 ms.
#include <pxr/usd/sdf/data.h>

#include <algorithm>
#include <chrono>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <thread>
#include <utility>
#include <vector>

#include "support/Figures.h"
#include "support/LiveClient.h"
#include "support/Server.h"

using namespace usdlive::bench;

namespace {

struct Spec {
    pxr::SdfPath path;
    pxr::SdfSpecType type;
    std::vector<std::pair<pxr::TfToken, pxr::VtValue>> fields;
};

double fillBareData(const pxr::SdfLayerHandle& layer) {
    std::vector<Spec> specs;
    layer->Traverse(pxr::SdfPath::AbsoluteRootPath(), [&](const pxr::SdfPath& path) {
        Spec spec{path, layer->GetSpecType(path), {}};
        for (const auto& field : layer->ListFields(path))
            spec.fields.emplace_back(field, layer->GetField(path, field));
        specs.push_back(std::move(spec));
    });
    const auto begin = Clock::now();
    const auto data = pxr::TfCreateRefPtr(new pxr::SdfData);
    for (const Spec& spec : specs) {
        data->CreateSpec(spec.path, spec.type);
        for (const auto& [field, value] : spec.fields) data->Set(spec.path, field, value);
    }
    return millisecondsSince(begin);
}

// Joins like an editor whose stage has just composed the layer.
double longestTick(LiveClient& joining) {
    using namespace std::chrono_literals;
    joining.layer =
        pxr::SdfLayer::FindOrOpen((joining.client->cacheFolder() / kLayer.value).string());
    if (!joining.layer) throw std::runtime_error("the layer has no placeholder");
    double longest = 0;
    std::size_t filling = 0;
    while (filling > 0 || joining.layer->GetRootPrims().empty()) {
        const auto begin = Clock::now();
        filling = joining.client->tick(4.0).filling;
        longest = std::max(longest, millisecondsSince(begin));
        std::this_thread::sleep_until(begin + 16ms);
    }
    return longest;
}

void measure(int fields) {
    const TemporaryFolder folder;
    writeLayer(folder.path(), fields);
    ServerProcess server(folder.path(), {"--min-free-mib=1"}, {});
    joinElsewhere(server.url());

    LiveClient joining(server.url());
    const auto begin = Clock::now();
    const double clientCpu = ownCpuSeconds(), serverCpu = server.process().cpuSeconds();
    joining.open();
    const double ms = millisecondsSince(begin);
    const double clientCpuMs = (ownCpuSeconds() - clientCpu) * 1000;
    const double serverCpuMs = (server.process().cpuSeconds() - serverCpu) * 1000;
    checkLayer(joining.layer, fields);
    const double ceilingMs = fillBareData(joining.layer);
    LiveClient editor(server.url());
    const double longestTickMs = longestTick(editor);
    checkLayer(editor.layer, fields);
    print(nlohmann::ordered_json{{"bench", "latejoin"},
                                 {"fields", fields},
                                 {"ms", ms},
                                 {"ceilingMs", ceilingMs},
                                 {"clientCpuMs", clientCpuMs},
                                 {"serverCpuMs", serverCpuMs},
                                 {"longestTickMs", longestTickMs}}
              .dump());
}

}  // namespace

int main(int argc, char** argv) {
    return runBench("latejoin", [&] {
        if (isJoin(argc, argv)) return runJoin(argv);
        Arguments arguments(argc, argv);
        const auto fields = arguments.numbers("--fields", {100'000, 1'000'000});
        arguments.finish();
        loadUsd();
        for (const int count : fields) measure(count);
    });
}
