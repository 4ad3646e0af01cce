// How long does somebody wait who joins a large layer?
//
//   --fields=100000,1000000
//
// From openLayer() of a fresh client over a real socket until the SdfLayer is filled. The ceiling
// is to set the same specs and fields, whose paths and values are there already, in a bare SdfData.
// `clientCpuMs` and `serverCpuMs` are all threads' work, which a busy machine changes little.
#include <pxr/usd/sdf/data.h>

#include <nlohmann/json.hpp>
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
    print(nlohmann::ordered_json{{"bench", "latejoin"},
                                 {"fields", fields},
                                 {"ms", ms},
                                 {"ceilingMs", ceilingMs},
                                 {"clientCpuMs", clientCpuMs},
                                 {"serverCpuMs", serverCpuMs}}
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
