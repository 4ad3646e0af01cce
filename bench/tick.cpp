// What does it cost an editor to follow others?
//
//   --edits=10000  --rounds=5
//
// One client's tick() applies what another one has authored and what has arrived already: as one
// transaction, and as one for each edit. `ratio` is to as many SdfLayer::SetField calls in one
// change block. Medians of the rounds.
#include <pxr/base/gf/vec3d.h>
#include <pxr/usd/sdf/changeBlock.h>

#include <chrono>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <thread>
#include <vector>

#include "support/Figures.h"
#include "support/LiveClient.h"
#include "support/Server.h"

using namespace usdlive::bench;

namespace {

using Paths = std::vector<pxr::SdfPath>;

pxr::VtValue valueOf(int round, std::size_t index) {
    return pxr::VtValue(pxr::GfVec3d(round + 1, double(index), 0.25));
}

double setBare(const pxr::SdfLayerHandle& layer, const Paths& paths, int round) {
    std::vector<pxr::VtValue> values;
    for (std::size_t i = 0; i < paths.size(); ++i) values.push_back(valueOf(round, i));
    const auto begin = Clock::now();
    {
        const pxr::SdfChangeBlock block;
        for (std::size_t i = 0; i < paths.size(); ++i)
            layer->SetField(paths[i], pxr::SdfFieldKeys->Default, values[i]);
    }
    return millisecondsSince(begin);
}

void author(LiveClient& author, const Paths& paths, int round, bool together) {
    for (std::size_t i = 0; i < paths.size(); ++i) {
        author.layer->SetField(paths[i], pxr::SdfFieldKeys->Default, valueOf(round, i));
        if (!together) author.client->tick();
    }
    if (!author.client->flush(60'000)) throw std::runtime_error("the edits were not committed");
    // The other one's network thread has it soon, too.
    std::this_thread::sleep_for(std::chrono::milliseconds(300));
}

double follow(LiveClient& follower, const Paths& paths, int round, usdlive::Revision revision) {
    const auto begin = Clock::now();
    do follower.client->tick(1e9);
    while (follower.client->revision() < revision);
    const double ms = millisecondsSince(begin);
    const auto last =
        follower.layer->GetField(paths.back(), pxr::SdfFieldKeys->Default).Get<pxr::GfVec3d>();
    if (last[0] != round + 1) throw std::runtime_error("an edit has not arrived");
    return ms;
}

void measure(LiveClient& writer, LiveClient& follower, const Paths& paths, int rounds,
             bool together) {
    const auto bareLayer = pxr::SdfLayer::CreateAnonymous(".usda");
    bareLayer->TransferContent(follower.layer);
    std::vector<float> ticks, bare;
    static int round = 0;
    for (int i = 0; i < rounds; ++i, ++round) {
        author(writer, paths, round, together);
        ticks.push_back(float(follow(follower, paths, round, writer.client->revision())));
        bare.push_back(float(setBare(bareLayer, paths, round)));
    }
    const double tick = percentile(ticks, 0.5), ceiling = percentile(bare, 0.5);
    print(nlohmann::ordered_json{{"bench", "tick"},
                                 {"edits", paths.size()},
                                 {"transactions", together ? 1 : paths.size()},
                                 {"usPerEdit", tick * 1000 / double(paths.size())},
                                 {"ratio", tick / ceiling}}
              .dump());
}

}  // namespace

int main(int argc, char** argv) {
    return runBench("tick", [&] {
        Arguments arguments(argc, argv);
        const int edits = arguments.number("--edits", 10'000);
        const int rounds = arguments.number("--rounds", 5);
        arguments.finish();
        const TemporaryFolder folder;
        writeLayer(folder.path(), edits);
        const ServerProcess server(folder.path(), {"--min-free-mib=1"}, {});
        LiveClient writer(server.url()), follower(server.url());
        writer.open();
        follower.open();
        Paths paths;
        for (int i = 0; i < edits; ++i) paths.emplace_back(attributePath(i));
        for (const bool together : {true, false})
            measure(writer, follower, paths, rounds, together);
    });
}
