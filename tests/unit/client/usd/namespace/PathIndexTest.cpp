// Tests that an index of paths that follows edits finds what a new one finds.
#include "usd/namespace/PathIndex.h"

#include <gtest/gtest.h>
#include <pxr/usd/sdf/changeBlock.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/namespaceEdit.h>
#include <pxr/usd/sdf/primSpec.h>
#include <pxr/usd/sdf/relationshipSpec.h>

#include <algorithm>
#include <random>
#include <set>

#include "unit/Seeds.h"

namespace usdlive::naming {
namespace {

using pxr::SdfLayer;
using pxr::SdfLayerRefPtr;
using pxr::SdfPath;

SdfPath randomPrimPath(std::mt19937& random) {
    SdfPath path = SdfPath::AbsoluteRootPath();
    for (auto depth = 1 + random() % 3; depth > 0; --depth)
        path = path.AppendChild(pxr::TfToken(std::string(1, char('A' + random() % 4))));
    return path;
}

void editLayer(const SdfLayerRefPtr& layer, std::mt19937& random) {
    const SdfPath path = randomPrimPath(random);
    const auto prim = pxr::SdfCreatePrimInLayer(layer, path);
    if (random() % 2 == 0) {
        const char* const name = random() % 2 == 0 ? "r" : "s";
        auto relationship = layer->GetRelationshipAtPath(path.AppendProperty(pxr::TfToken(name)));
        if (!relationship) relationship = pxr::SdfRelationshipSpec::New(prim, name);
        relationship->GetTargetPathList().GetExplicitItems() = {randomPrimPath(random)};
        return;
    }
    pxr::SdfBatchNamespaceEdit batch;
    switch (random() % 4) {
        case 0:
            batch.Add(path, SdfPath());
            break;
        case 1: {  // a swap
            const SdfPath other = randomPrimPath(random), third("/Third");
            for (const auto& [from, to] : PathMoves{{path, third}, {other, path}, {third, other}})
                batch.Add(from, to, pxr::SdfNamespaceEdit::Same);
            break;
        }
        default:
            batch.Add(path, randomPrimPath(random), pxr::SdfNamespaceEdit::Same);
    }
    if (layer->CanApply(batch)) layer->Apply(batch);
}

std::set<SdfPath> found(LayerPaths& index, const SdfLayerRefPtr& layer, const SdfPath& target) {
    pxr::SdfPathVector specs;
    index.specsWithPathsTo(target, specs);
    std::set<SdfPath> present;
    for (const SdfPath& spec : specs)
        if (layer->HasSpec(spec)) present.insert(spec);
    return present;
}

// The index may also return specs that no longer refer to the path.
TEST(PathIndex, FindsAfterEachEditWhatANewOneFinds) {
    std::size_t results = 0;
    for (unsigned seed = 0; seed < seedsOf(300); ++seed) {
        SCOPED_TRACE(seed);
        std::mt19937 random(seed);
        const auto layer = SdfLayer::CreateAnonymous(".usda");
        PathIndex index;
        index.of(layer).read();
        for (int step = 0; step < 30; ++step) {
            SCOPED_TRACE(step);
            {
                const pxr::SdfChangeBlock block;
                for (auto count = 1 + random() % 3; count > 0; --count) editLayer(layer, random);
            }
            LayerPaths fresh(layer);
            for (const char* target : {"/A", "/B", "/C/A", "/D/B"}) {
                const auto known = found(index.of(layer), layer, SdfPath(target));
                const auto expected = found(fresh, layer, SdfPath(target));
                ASSERT_TRUE(std::ranges::includes(known, expected)) << target;
                results += expected.size();
            }
        }
    }
    EXPECT_GT(results, 10'000u);
}

}  // namespace
}  // namespace usdlive::naming
