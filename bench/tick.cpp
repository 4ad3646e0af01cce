// Measures an editor's cost of following others.
//
//   --edits=10000  --rounds=5  --prims=20000  --paste=10000
//
// One client's tick() applies edits that another one authored and that have arrived already: as one
// transaction, and as one for each edit. `ratio` compares it with as many SdfLayer::SetField calls
// in one change block. Figures are medians of the rounds.
//
// `override` is the first opinion on a deep prim in an empty sublayer, and its removal, on a stage
// of `prims` prims that both editors have composed. `ratio` compares the follower's tick with the
// cost of the edit for its author, both with their recomposition.
//
// `paste` is a subtree of that many prims, with two attributes each, that an author copies into a
// layer. All editors have composed it. `authorRatio` compares the author's next tick with the copy
// itself, `followerRatio` the follower's tick with the same copy into a layer that is not live.
//
// `arrayMiB` is one array that the editor itself sets: its longest tick until the server has the
// array. `ratio` compares it with the time of encoding the array, which happens beside the frame.
#include <pxr/base/gf/vec3d.h>
#include <pxr/base/gf/vec3f.h>
#include <pxr/base/vt/array.h>
#include <pxr/usd/sdf/attributeSpec.h>
#include <pxr/usd/sdf/changeBlock.h>
#include <pxr/usd/sdf/copyUtils.h>
#include <pxr/usd/sdf/primSpec.h>

#include <chrono>
#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>
#include <thread>
#include <vector>

#include "support/ComposedPrims.h"
#include "support/Figures.h"
#include "support/LiveClient.h"
#include "support/Server.h"
#include "usdlive/common/usd/ValueCodec.h"

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
    // Waits until the network thread of the other client has received it, too.
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

// ---- a first override

const usdlive::LayerId kOverrides{"overrides.usda"};
constexpr int kPrimsPerGroup = 100;

void writeStage(const std::filesystem::path& folder, int prims) {
    std::ofstream(folder / kOverrides.value) << "#usda 1.0\n";
    std::ofstream(folder / kLayer.value)
        << "#usda 1.0\n(\n    subLayers = [@./overrides.usda@, @./set.usda@]\n)\n";
    std::ofstream set(folder / "set.usda");
    set << "#usda 1.0\n\ndef Xform \"World\"\n{\n";
    for (int prim = 0; prim < prims; ++prim) {
        if (prim % kPrimsPerGroup == 0)
            set << "def Xform \"g" << prim / kPrimsPerGroup << "\"\n{\n";
        set << "def Xform \"p" << prim << "\"\n{\n}\n";
        if (prim % kPrimsPerGroup == kPrimsPerGroup - 1 || prim == prims - 1) set << "}\n";
    }
    set << "}\n";
}

// One editor's client, layer and stage.
struct Editor {
    explicit Editor(const std::string& url) : client(url) {
        client.open();
        overrides = client.client->openLayer(kOverrides).value();
        stage.emplace(client.layer);
    }

    LiveClient client;
    pxr::SdfLayerRefPtr overrides;
    std::optional<ComposedPrims> stage;
};

struct Cost {
    double ms = 0;
    std::size_t composed = 0;
};

template <class Work>
Cost costOf(Editor& editor, Work work) {
    (void)editor.stage->takeComposed();
    const auto begin = Clock::now();
    work();
    return {millisecondsSince(begin), editor.stage->takeComposed()};
}

template <class Edit>
void measureOverride(const char* what, Editor& author, Editor& follower, int rounds, Edit edit,
                     Edit undo) {
    std::vector<float> own, others;
    std::size_t composed = 0;
    const auto follow = [&] {
        if (!author.client.client->flush(60'000))
            throw std::runtime_error("the edits were not committed");
        std::this_thread::sleep_for(std::chrono::milliseconds(50));
        return costOf(follower, [&] {
            do follower.client.client->tick(1e9);
            while (follower.client.client->revision() < author.client.client->revision());
        });
    };
    for (int i = 0; i < rounds; ++i) {
        const Cost wrote = costOf(author, edit);
        const Cost followed = follow();
        own.push_back(float(wrote.ms));
        others.push_back(float(followed.ms));
        composed = std::max(composed, followed.composed);
        undo();
        (void)follow();
    }
    const double tick = percentile(others, 0.5), wrote = percentile(own, 0.5);
    print(nlohmann::ordered_json{{"bench", "tick"},
                                 {"override", what},
                                 {"tickMs", tick},
                                 {"authorMs", wrote},
                                 {"ratio", tick / wrote},
                                 {"primsComposed", composed}}
              .dump());
}

void measureOverrides(int prims, int rounds) {
    const TemporaryFolder folder;
    writeStage(folder.path(), prims);
    const ServerProcess server(folder.path(), {"--min-free-mib=1"}, {});
    Editor author(server.url()), follower(server.url());
    const pxr::SdfPath path("/World/g0/p" + std::to_string(std::min(prims, kPrimsPerGroup) / 2));
    const std::function write = [&] {
        const pxr::SdfChangeBlock block;
        pxr::SdfCreatePrimInLayer(author.overrides, path);
        author.overrides->SetField(path, pxr::SdfFieldKeys->Comment, std::string("here"));
    };
    const std::function remove = [&] {
        const pxr::SdfChangeBlock block;
        author.overrides->EraseField(path, pxr::SdfFieldKeys->Comment);
        author.overrides->ScheduleRemoveIfInert(author.overrides->GetPrimAtPath(path).GetSpec());
    };
    measureOverride("set", author, follower, rounds, write, remove);
    write();
    measureOverride("removed", author, follower, rounds, remove, write);
}

// ---- a paste

const pxr::SdfPath kSet("/Set");

pxr::SdfLayerRefPtr subtree(int prims) {
    auto layer = pxr::SdfLayer::CreateAnonymous(".usda");
    const pxr::SdfChangeBlock block;
    for (int prim = 0; prim < prims; ++prim) {
        const auto path = kSet.AppendPath(pxr::SdfPath("g" + std::to_string(prim / kPrimsPerGroup) +
                                                       "/p" + std::to_string(prim)));
        const auto spec = pxr::SdfCreatePrimInLayer(layer, path);
        spec->SetSpecifier(pxr::SdfSpecifierDef);
        const auto& types = pxr::SdfValueTypeNames;
        const auto size = pxr::SdfAttributeSpec::New(spec, "size", types->Double);
        size->SetDefaultValue(pxr::VtValue(double(prim)));
        const auto at = pxr::SdfAttributeSpec::New(spec, "at", types->Double3);
        at->SetDefaultValue(valueOf(prim, 1));
    }
    return layer;
}

double paste(const pxr::SdfLayerHandle& from, const pxr::SdfLayerHandle& to, int round) {
    const pxr::SdfPath target("/Pasted" + std::to_string(round));
    const auto begin = Clock::now();
    {
        const pxr::SdfChangeBlock block;
        if (!pxr::SdfCopySpec(from, kSet, to, target))
            throw std::runtime_error("the prims cannot be copied");
    }
    return millisecondsSince(begin);
}

void measurePaste(int prims, int rounds) {
    const TemporaryFolder folder;
    std::ofstream(folder.path() / kLayer.value) << "#usda 1.0\n";
    const ServerProcess server(folder.path(), {"--min-free-mib=1"}, {});
    LiveClient author(server.url()), follower(server.url());
    author.open();
    follower.open();
    const auto source = subtree(prims);
    const auto bareLayer = pxr::SdfLayer::CreateAnonymous(".usda");
    const ComposedPrims composed[]{ComposedPrims(author.layer), ComposedPrims(follower.layer),
                                   ComposedPrims(bareLayer)};
    std::vector<float> pastes, authors, followers, bare;
    for (int round = 0; round < rounds; ++round) {
        pastes.push_back(float(paste(source, author.layer, round)));
        const auto begin = Clock::now();
        author.client->tick();
        authors.push_back(float(millisecondsSince(begin)));
        if (!author.client->flush(600'000)) throw std::runtime_error("the paste was not committed");
        std::this_thread::sleep_for(std::chrono::milliseconds(300 + prims / 50));
        const auto arrived = Clock::now();
        do follower.client->tick(1e9);
        while (follower.client->revision() < author.client->revision());
        followers.push_back(float(millisecondsSince(arrived)));
        bare.push_back(float(paste(source, bareLayer, round)));
    }
    const double pasted = percentile(pastes, 0.5), wrote = percentile(authors, 0.5);
    const double tick = percentile(followers, 0.5), ceiling = percentile(bare, 0.5);
    print(nlohmann::ordered_json{{"bench", "tick"},
                                 {"paste", prims},
                                 {"pasteMs", pasted},
                                 {"authorMs", wrote},
                                 {"authorRatio", wrote / pasted},
                                 {"bareMs", ceiling},
                                 {"followerMs", tick},
                                 {"followerRatio", tick / ceiling}}
              .dump());
}

// ---- an array that the editor sets

struct NoBlobs final : usdlive::BlobSink {
    void keepBlob(const usdlive::Hash&, usdlive::SharedBytes) override {}
};

void measureArray(LiveClient& author, const pxr::SdfPath& prim, std::size_t mebibytes) {
    const std::size_t count = (mebibytes << 20) / sizeof(pxr::GfVec3f);
    pxr::VtArray<pxr::GfVec3f> points(count);
    for (std::size_t i = 0; i < count; ++i) points[i] = pxr::GfVec3f(float(i), 1, 2);
    const pxr::VtValue value(points);

    const auto begin = Clock::now();
    NoBlobs blobs;
    if (!usdlive::usd::encodeLeaf(value, blobs))
        throw std::runtime_error("the array cannot be encoded");
    const double encodeMs = millisecondsSince(begin);

    const auto spec = pxr::SdfAttributeSpec::New(author.layer->GetPrimAtPath(prim), "cloud",
                                                 pxr::SdfValueTypeNames->Point3fArray);
    if (!author.client->flush(60'000)) throw std::runtime_error("the attribute was not committed");
    const auto revision = author.client->revision();
    spec->SetDefaultValue(value);
    double longest = 0;
    std::size_t ticks = 0;
    while (author.client->revision() == revision) {
        const auto tick = Clock::now();
        author.client->tick();
        longest = std::max(longest, millisecondsSince(tick));
        ++ticks;
        std::this_thread::sleep_for(std::chrono::milliseconds(2));
    }
    print(nlohmann::ordered_json{{"bench", "tick"},
                                 {"arrayMiB", mebibytes},
                                 {"longestTickMs", longest},
                                 {"encodeMs", encodeMs},
                                 {"ratio", longest / encodeMs},
                                 {"ticks", ticks}}
              .dump());
}

}  // namespace

int main(int argc, char** argv) {
    return runBench("tick", [&] {
        Arguments arguments(argc, argv);
        const int edits = arguments.number("--edits", 10'000);
        const int rounds = arguments.number("--rounds", 5);
        const int prims = arguments.number("--prims", 20'000);
        const int pasted = arguments.number("--paste", 10'000);
        arguments.finish();
        measureOverrides(prims, rounds);
        measurePaste(pasted, rounds);
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
        measureArray(writer, paths.front().GetPrimPath(), 200);
    });
}
