// Tests that a ComposedStage that follows edits shows what a new one shows.
#include "usd/namespace/ComposedStage.h"

#include <gtest/gtest.h>
#include <pxr/usd/sdf/changeBlock.h>
#include <pxr/usd/sdf/copyUtils.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/primSpec.h>
#include <pxr/usd/sdf/reference.h>
#include <pxr/usd/sdf/schema.h>

#include <random>
#include <string>
#include <vector>

#include "unit/Seeds.h"

namespace usdlive::naming {
namespace {

using pxr::SdfFieldKeys;
using pxr::SdfLayer;
using pxr::SdfLayerRefPtr;
using pxr::SdfPath;

const char* const kNames[] = {"A", "B", "C"};

std::string shownBelow(ComposedStage& stage, const SdfPath& path, int depth) {
    std::string text;
    for (const char* name : kNames) {
        const SdfPath child = path.AppendChild(pxr::TfToken(name));
        const auto* prim = stage.prim(child);
        if (!prim) continue;
        text += child.GetString() + " " + ComposedStage::typeName(*prim).GetString() +
                (ComposedStage::isActive(*prim) ? "" : " inactive") +
                (stage.isInstance(child) ? " instance" : "") +
                (stage.isInstanceProxy(child) ? " proxy" : "") + "\n";
        if (depth > 1) text += shownBelow(stage, child, depth - 1);
    }
    return text;
}

std::string shown(ComposedStage& stage) {
    return shownBelow(stage, SdfPath::AbsoluteRootPath(), 4);
}

/// Makes random edits of a root layer, its sublayer and an asset.
class Edits {
public:
    explicit Edits(unsigned seed) : random_(seed) {
        layers_ = {SdfLayer::CreateAnonymous("root.usda"), SdfLayer::CreateAnonymous("sub.usda"),
                   SdfLayer::CreateAnonymous("asset.usda")};
        layers_[0]->InsertSubLayerPath(layers_[1]->GetIdentifier());
    }

    [[nodiscard]] const SdfLayerRefPtr& root() const { return layers_.front(); }

    void edit() {
        const pxr::SdfChangeBlock block;
        for (auto count = 1 + below(3); count > 0; --count) editOnce();
    }

private:
    unsigned below(unsigned end) { return unsigned(random_() % end); }
    SdfPath somewhere() {
        SdfPath path = SdfPath::AbsoluteRootPath();
        for (auto depth = 1 + below(3); depth > 0; --depth)
            path = path.AppendChild(pxr::TfToken(kNames[below(3)]));
        return path;
    }

    void editOnce() {
        const auto& layer = layers_[below(3)];
        const SdfPath path = somewhere();
        const auto prim = layer->GetPrimAtPath(path);
        if (!prim || below(10) == 0) return make(layer, path);
        switch (below(9)) {
            case 0:
                layer->SetField(path, SdfFieldKeys->Active, below(2) == 0);
                break;
            case 1:
                layer->EraseField(path, SdfFieldKeys->Active);
                break;
            case 2:
                layer->SetField(path, SdfFieldKeys->Instanceable, below(3) != 0);
                break;
            case 3:
                prim->GetReferenceList().Prepend(
                    {below(2) == 0 ? layers_[2]->GetIdentifier() : std::string(), somewhere()});
                break;
            case 4:
                prim->GetReferenceList().ClearEdits();
                break;
            case 5:
                prim->GetInheritPathList().Prepend(somewhere());
                break;
            case 6: {
                pxr::SdfBatchNamespaceEdit batch;
                batch.Add(path, somewhere(), pxr::SdfNamespaceEdit::Same);
                if (layer->CanApply(batch)) layer->Apply(batch);
                break;
            }
            case 7:
                (void)layer->Apply([&] {
                    pxr::SdfBatchNamespaceEdit batch;
                    batch.Add(path, SdfPath());
                    return batch;
                }());
                break;
            default:
                editRoot();
        }
    }

    void make(const SdfLayerRefPtr& layer, const SdfPath& path) {
        const auto prim = pxr::SdfCreatePrimInLayer(layer, path);
        if (below(4) == 0) return;  // an over without content
        prim->SetSpecifier(pxr::SdfSpecifierDef);
        prim->SetTypeName(below(2) == 0 ? "Scope" : "Xform");
    }

    void editRoot() {
        if (below(2) == 0) {
            const bool has = !root()->GetSubLayerPaths().empty();
            if (has)
                root()->RemoveSubLayerPath(0);
            else
                root()->InsertSubLayerPath(layers_[1]->GetIdentifier());
        } else if (const SdfPath from = somewhere(), to = somewhere(); !from.IsRootPrimPath()) {
            root()->SetRelocates({{from, to}});
        } else {
            root()->SetRelocates({});
        }
    }

    std::mt19937 random_;
    std::vector<SdfLayerRefPtr> layers_;
};

TEST(ComposedStage, ShowsAfterEachEditWhatANewOneShows) {
    const StageView all, masked{.muted = {},
                                .loadRules = {},
                                .mask = {SdfPath("/A"), SdfPath("/B/C")},
                                .variantFallbacks = {}};
    std::size_t changed = 0;
    constexpr unsigned kSeeds = seedsOf(150);
    for (unsigned seed = 0; seed < kSeeds; ++seed) {
        SCOPED_TRACE(seed);
        Edits edits(seed);
        ComposedStage stage(edits.root(), {}, all), part(edits.root(), {}, masked);
        std::string before;
        for (int step = 0; step < 25; ++step) {
            SCOPED_TRACE(step);
            edits.edit();
            if (step % 3 == 1) continue;  // the stage follows several edits before the next query
            ComposedStage newStage(edits.root(), {}, all), newPart(edits.root(), {}, masked);
            const auto expected = shown(newStage);
            ASSERT_EQ(shown(stage), expected);
            ASSERT_EQ(shown(part), shown(newPart));
            changed += expected != std::exchange(before, expected);
        }
    }
    EXPECT_GT(changed, kSeeds * 1000 / 150);
}

}  // namespace
}  // namespace usdlive::naming
