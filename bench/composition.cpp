// Measures the cost of an edit of one value for a composition that is kept, and counts the prims
// that it composes again.
//
//   --layers=32  --prims=10000  --edits=2000  --rounds=9
//
// A root layer has `layers` sublayers; each of `prims` prims is defined in one of them and has an
// opinion in the next, and every tenth references an asset. All prims are composed once. Then
// values are set one by one, and the edited prim is queried after each. `ratio` compares this with
// bare SdfLayer::SetField calls of the same edits on copies of the layers without listeners.
// `fresh` is for comparison: each edit discards the composition and composes the queried prim;
// `freshAll` composes all prims. `arc` adds a reference to one prim and queries it; `usedLayers` is
// the query of the whole stage after that. `recomposed` counts prims, over all edits of a run.
// Figures are medians of the rounds.
#include "usd/stage/Composition.h"

#include <pxr/base/tf/notice.h>
#include <pxr/base/tf/weakBase.h>
#include <pxr/usd/sdf/attributeSpec.h>
#include <pxr/usd/sdf/changeBlock.h>
#include <pxr/usd/sdf/notice.h>
#include <pxr/usd/sdf/primSpec.h>
#include <pxr/usd/sdf/reference.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <vector>

#include "support/Figures.h"

using namespace usdlive::bench;
using usdlive::stage::Composition;

namespace {

using LayerVector = std::vector<pxr::SdfLayerRefPtr>;
using Paths = std::vector<pxr::SdfPath>;

constexpr auto kAll = Composition::Payloads::All;

pxr::SdfPath primPath(int index) {
    return pxr::SdfPath("/World/Group" + std::to_string(index / 100) + "/Prim" +
                        std::to_string(index));
}

struct Layers {
    pxr::SdfLayerRefPtr root = pxr::SdfLayer::CreateAnonymous("root.usda");
    pxr::SdfLayerRefPtr asset = pxr::SdfLayer::CreateAnonymous("asset.usda");
    LayerVector sublayers;
};

Layers makeLayers(int count, const Paths& prims) {
    Layers all;
    for (int i = 0; i < count; ++i) {
        all.sublayers.push_back(pxr::SdfLayer::CreateAnonymous("sub.usda"));
        all.root->InsertSubLayerPath(all.sublayers.back()->GetIdentifier());
    }
    const pxr::SdfChangeBlock block;
    for (const char* path : {"/Asset/Body", "/Asset/Wheel"})
        pxr::SdfCreatePrimInLayer(all.asset, pxr::SdfPath(path));
    for (std::size_t i = 0; i < prims.size(); ++i) {
        const auto& owner = all.sublayers[i % all.sublayers.size()];
        const auto prim = pxr::SdfCreatePrimInLayer(owner, prims[i]);
        prim->SetSpecifier(pxr::SdfSpecifierDef);
        if (i % 10 == 0)
            prim->GetReferenceList().Prepend(
                pxr::SdfReference(all.asset->GetIdentifier(), pxr::SdfPath("/Asset")));
        for (const std::size_t at : {i, i + 1})
            pxr::SdfJustCreatePrimAttributeInLayer(all.sublayers[at % all.sublayers.size()],
                                                   prims[i].AppendProperty(pxr::TfToken("size")),
                                                   pxr::SdfValueTypeNames->Double);
    }
    return all;
}

/// Makes a composition follow all layers of this process during its own lifetime.
class Following : public pxr::TfWeakBase {
public:
    explicit Following(Composition& composition)
        : composition_(composition),
          key_(pxr::TfNotice::Register(pxr::TfCreateWeakPtr(this), &Following::onChanged)) {}
    ~Following() { pxr::TfNotice::Revoke(key_); }

private:
    void onChanged(const pxr::SdfNotice::LayersDidChange& notice) {
        composition_.follow(notice.GetChangeListVec());
    }
    Composition& composition_;
    pxr::TfNotice::Key key_;
};

/// Sets `edits` values, one after the other, and calls `ask` with the prim after each one.
template <class Ask>
double setValues(const Layers& layers, const Paths& prims, int edits, int round, Ask ask) {
    struct Edit {
        pxr::SdfLayerHandle layer;
        pxr::SdfPath prim, attribute;
        pxr::VtValue value;
    };
    std::vector<Edit> all;
    for (int i = 0; i < edits; ++i) {
        const std::size_t at = std::size_t(i) * 7919 % prims.size();
        all.push_back({layers.sublayers[at % layers.sublayers.size()], prims[at],
                       prims[at].AppendProperty(pxr::TfToken("size")),
                       pxr::VtValue(double(round * edits + i))});
    }
    const auto begin = Clock::now();
    for (const auto& edit : all) {
        edit.layer->SetField(edit.attribute, pxr::SdfFieldKeys->Default, edit.value);
        ask(edit.prim);
    }
    return millisecondsSince(begin);
}

void measure(int count, int primCount, int edits, int rounds) {
    Paths prims;
    for (int i = 0; i < primCount; ++i) prims.push_back(primPath(i));
    const Layers layers = makeLayers(count, prims), bareLayers = makeLayers(count, prims);
    Composition kept(layers.root, {}, {}, kAll);
    (void)kept.usedLayers();
    const auto askKept = [&](const pxr::SdfPath& prim) {
        if (!kept.primIndex(prim)) throw std::runtime_error("a prim is not composed");
    };
    const auto askNobody = [](const pxr::SdfPath&) {};
    const auto askFresh = [&](const pxr::SdfPath& prim) {
        Composition fresh(layers.root, {}, {}, kAll);
        if (!fresh.primIndex(prim)) throw std::runtime_error("a prim is not composed");
    };
    const int freshEdits = std::min(edits, 200);
    std::vector<float> keptMs, bareMs, freshMs, freshAllMs, arcMs, usedMs;
    std::size_t recomposed = 0, recomposedByArcs = 0;
    for (int round = 0; round < rounds; ++round) {
        bareMs.push_back(float(setValues(bareLayers, prims, edits, round, askNobody)));
        freshMs.push_back(float(setValues(layers, prims, freshEdits, round, askFresh)));
        const auto begin = Clock::now();
        (void)Composition(layers.root, {}, {}, kAll).usedLayers();
        freshAllMs.push_back(float(millisecondsSince(begin)));

        const Following following(kept);
        const auto before = kept.primsComposed();
        keptMs.push_back(float(setValues(layers, prims, edits, round, askKept)));
        (void)kept.usedLayers();
        const auto afterValues = kept.primsComposed();
        const auto prim = layers.sublayers.front()->GetPrimAtPath(
            prims[std::size_t(round * 10 + 1) * layers.sublayers.size() % prims.size()]);
        const auto arc = Clock::now();
        prim->GetReferenceList().Prepend(
            pxr::SdfReference(layers.asset->GetIdentifier(), pxr::SdfPath("/Asset/Body")));
        askKept(prim->GetPath());
        arcMs.push_back(float(millisecondsSince(arc)));
        const auto used = Clock::now();
        (void)kept.usedLayers();
        usedMs.push_back(float(millisecondsSince(used)));
        recomposed += afterValues - before;
        recomposedByArcs += kept.primsComposed() - afterValues;
    }
    const double keptUs = percentile(keptMs, 0.5) * 1000 / edits;
    const double bareUs = percentile(bareMs, 0.5) * 1000 / edits;
    const double freshUs = percentile(freshMs, 0.5) * 1000 / freshEdits;
    print(nlohmann::ordered_json{{"bench", "composition"},
                                 {"layers", count},
                                 {"prims", primCount},
                                 {"edits", edits * rounds},
                                 {"recomposed", recomposed},
                                 {"usPerEdit", keptUs},
                                 {"bareUsPerEdit", bareUs},
                                 {"ratio", keptUs / bareUs},
                                 {"freshUsPerEdit", freshUs},
                                 {"freshToKept", freshUs / keptUs},
                                 {"freshAllMs", percentile(freshAllMs, 0.5)},
                                 {"arcs", rounds},
                                 {"recomposedByArcs", recomposedByArcs},
                                 {"usPerArc", percentile(arcMs, 0.5) * 1000},
                                 {"usedLayersMs", percentile(usedMs, 0.5)}}
              .dump());
}

}  // namespace

int main(int argc, char** argv) {
    return runBench("composition", [&] {
        Arguments arguments(argc, argv);
        const int layers = arguments.number("--layers", 32);
        const int prims = arguments.number("--prims", 10'000);
        const int edits = arguments.number("--edits", 2'000);
        const int rounds = arguments.number("--rounds", 9);
        arguments.finish();
        measure(layers, prims, edits, rounds);
    });
}
