// Measures the cost of a frame of auto authoring, and of queries of a layer's state.
//
//   --edits=10000  --layers=8  --rounds=15  --states=200
//
// Writes `edits` attributes into the delegate; one update() distributes them over `layers`
// sublayers. `ratio` compares it with as many SdfLayer::SetField calls of the same edits in one
// change block, in the same run. `first` is the frame before which the delegate was empty.
// `recomposed` counts the prims that all frames after it composed again, of `composed` prims of the
// stage; `recomposedFirst` counts those of the first frame. The second line measures queries on a
// stack of `states` layers, each with a file. Figures are medians of the rounds.
#include <pxr/base/gf/vec3d.h>
#include <pxr/usd/sdf/attributeSpec.h>
#include <pxr/usd/sdf/changeBlock.h>
#include <pxr/usd/sdf/primSpec.h>

#include <nlohmann/json.hpp>
#include <stdexcept>
#include <vector>

#include "support/Figures.h"
#include "support/Server.h"
#include "usd/stage/Composition.h"
#include "usdlive/client/usd/layers/LayerStackHost.h"
#include "usdlive/client/usd/layers/Layers.h"

using namespace usdlive::bench;
namespace layers = usdlive::layers;

namespace {

using LayerVector = std::vector<pxr::SdfLayerRefPtr>;
using Paths = std::vector<pxr::SdfPath>;

pxr::VtValue valueOf(int round, std::size_t index) {
    return pxr::VtValue(pxr::GfVec3d(round + 1, double(index), 0.25));
}

void make(const pxr::SdfLayerHandle& layer, const pxr::SdfPath& path) {
    pxr::SdfJustCreatePrimAttributeInLayer(layer, path, pxr::SdfValueTypeNames->Double3);
    layer->SetField(path, pxr::SdfFieldKeys->Default, valueOf(-1, 0));
}

LayerVector makeLayers(int count, const Paths& paths) {
    LayerVector all;
    for (int i = 0; i < count; ++i) all.push_back(pxr::SdfLayer::CreateAnonymous("sub.usda"));
    const pxr::SdfChangeBlock block;
    for (std::size_t i = 0; i < paths.size(); ++i) make(all[i % all.size()], paths[i]);
    return all;
}

double setBare(const LayerVector& all, const Paths& paths, int round) {
    std::vector<pxr::VtValue> values;
    for (std::size_t i = 0; i < paths.size(); ++i) values.push_back(valueOf(round, i));
    const auto begin = Clock::now();
    {
        const pxr::SdfChangeBlock block;
        for (std::size_t i = 0; i < paths.size(); ++i)
            all[i % all.size()]->SetField(paths[i], pxr::SdfFieldKeys->Default, values[i]);
    }
    return millisecondsSince(begin);
}

void author(const pxr::SdfLayerHandle& delegate, const Paths& paths, int round) {
    const pxr::SdfChangeBlock block;
    for (std::size_t i = 0; i < paths.size(); ++i) {
        if (!delegate->HasSpec(paths[i]))
            pxr::SdfJustCreatePrimAttributeInLayer(delegate, paths[i],
                                                   pxr::SdfValueTypeNames->Double3);
        delegate->SetField(paths[i], pxr::SdfFieldKeys->Default, valueOf(round, i));
    }
}

void check(const LayerVector& all, const Paths& paths, int round) {
    for (std::size_t i = 0; i < paths.size(); ++i)
        if (all[i % all.size()]->GetField(paths[i], pxr::SdfFieldKeys->Default) !=
            valueOf(round, i))
            throw std::runtime_error("an edit is in the wrong layer");
}

void measureDistribution(int edits, int count, int rounds) {
    Paths paths;
    for (int i = 0; i < edits; ++i) paths.emplace_back(attributePath(i));
    const auto all = makeLayers(count, paths), bareLayers = makeLayers(count, paths);
    const auto root = pxr::SdfLayer::CreateAnonymous("root.usda");
    for (const auto& layer : all) root->InsertSubLayerPath(layer->GetIdentifier());
    auto owned = std::make_unique<layers::LayerStackHost>(
        root, pxr::SdfLayer::CreateAnonymous("session.usda"));
    auto& host = *owned;
    layers::Layers instance(std::move(owned));
    if (const auto set = instance.setEditMode(layers::LayerEditMode::AutoAuthoring); !set)
        throw std::runtime_error(set.error().text);
    instance.update(0);
    // Queries all prims, so that each prim that the frame has invalidated is composed again.
    const auto composed = [&] {
        (void)host.usedLayers();
        return host.composition()->primsComposed();
    };
    std::vector<float> frames, bare;
    double first = 0;
    const std::size_t atFirst = composed();
    std::size_t afterFirst = 0;
    for (int round = 0; round <= rounds; ++round) {
        author(host.editTarget(), paths, round);
        const auto begin = Clock::now();
        instance.update(0);  // no time passes, so that files are not checked
        const double ms = millisecondsSince(begin);
        (void)instance.takeEvents();
        check(all, paths, round);
        if (round == 0) {
            first = ms;
            afterFirst = composed();
        }
        if (round > 0) frames.push_back(float(ms));
        bare.push_back(float(setBare(bareLayers, paths, round)));
    }
    const double frame = percentile(frames, 0.5), ceiling = percentile(bare, 0.5);
    print(nlohmann::ordered_json{{"bench", "autoauthor"},
                                 {"edits", edits},
                                 {"layers", count},
                                 {"usPerEdit", frame * 1000 / edits},
                                 {"bareUsPerEdit", ceiling * 1000 / edits},
                                 {"ratio", frame / ceiling},
                                 {"first", first / ceiling},
                                 {"composed", atFirst},
                                 {"recomposedFirst", afterFirst - atFirst},
                                 {"recomposed", composed() - afterFirst}}
              .dump());
}

void measureStates(int count) {
    const TemporaryFolder folder;
    LayerVector all;
    const auto root = pxr::SdfLayer::CreateNew((folder.path() / "root.usda").string());
    for (int i = 0; i < count; ++i) {
        const auto name = "sub" + std::to_string(i) + ".usda";
        all.push_back(pxr::SdfLayer::CreateNew((folder.path() / name).string()));
        root->InsertSubLayerPath("./" + name);
    }
    layers::Layers instance(std::make_unique<layers::LayerStackHost>(root));
    instance.update(0);
    auto& state = instance.state();
    int yes = 0;
    const auto each = [&](bool (layers::LayersState::*query)(const std::string&)) {
        constexpr int kRepeats = 200;
        const auto begin = Clock::now();
        for (int i = 0; i < kRepeats; ++i)
            for (const auto& layer : all) yes += (state.*query)(layer->GetIdentifier());
        return millisecondsSince(begin) * 1000 / (kRepeats * count);
    };
    nlohmann::ordered_json figures{{"bench", "layerstates"}, {"layers", count}};
    figures["writableUs"] = each(&layers::LayersState::isLayerWritable);
    figures["savableUs"] = each(&layers::LayersState::isLayerSavable);
    figures["lockedUs"] = each(&layers::LayersState::isLayerLocked);
    figures["mutedUs"] = each(&layers::LayersState::isLayerLocallyMuted);
    figures["outdatedUs"] = each(&layers::LayersState::isLayerOutdated);
    figures["dirtyUs"] = each(&layers::LayersState::isLayerDirty);
    if (yes == 0) throw std::runtime_error("no layer is writable");
    print(figures.dump());
}

}  // namespace

int main(int argc, char** argv) {
    return runBench("autoauthor", [&] {
        Arguments arguments(argc, argv);
        const int edits = arguments.number("--edits", 10'000);
        const int count = arguments.number("--layers", 8);
        const int rounds = arguments.number("--rounds", 15);
        const int states = arguments.number("--states", 200);
        arguments.finish();
        measureDistribution(edits, count, rounds);
        measureStates(states);
    });
}
