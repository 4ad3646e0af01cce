// Tests Stage: its tree of prims, its updates after edits, and its notices to subscribers.
#include "usdlive/client/usd/stage/Stage.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <malloc.h>
#include <pxr/base/tf/errorMark.h>
#include <pxr/usd/sdf/attributeSpec.h>
#include <pxr/usd/sdf/changeBlock.h>
#include <pxr/usd/sdf/copyUtils.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/primSpec.h>
#include <pxr/usd/sdf/schema.h>
#include <pxr/usd/sdf/variantSetSpec.h>
#include <pxr/usd/sdf/variantSpec.h>

#include <random>
#include <sstream>

#include "unit/Seeds.h"

using namespace usdlive::stage;
using pxr::SdfFieldKeys;
using pxr::SdfLayer;
using pxr::SdfLayerRefPtr;
using pxr::SdfPath;
using pxr::TfToken;
using testing::ElementsAre;
using testing::IsEmpty;

namespace {

// Creates a layer from a text. The text may have several prims on one line, which .usda does not
// allow.
SdfLayerRefPtr layerOf(const std::string& text) {
    std::string lines = "#usda 1.0\n";
    for (const char one : text)
        lines += one == '{' ? "{\n" : one == '}' ? "\n}\n" : std::string(1, one);
    auto layer = SdfLayer::CreateAnonymous(".usda");
    EXPECT_TRUE(layer->ImportFromString(lines)) << lines;
    return layer;
}

std::vector<std::string> pathsOf(const std::vector<Prim>& prims) {
    std::vector<std::string> paths;
    for (const auto& prim : prims) paths.push_back(prim.path().GetAsString());
    return paths;
}

std::vector<std::string> pathsOf(const std::set<SdfPath>& all) {
    std::vector<std::string> paths;
    for (const auto& path : all) paths.push_back(path.GetAsString());
    return paths;
}

// Writes all facts that the tree keeps of each prim, to compare an edited stage with a new one.
std::string described(const Stage& stage) {
    std::ostringstream text;
    stage.traverse(PrimPredicate::all().throughInstances(), [&](const Prim& prim) {
        text << prim.path() << " " << prim.typeName() << " " << prim.flags();
        for (const auto& schema : prim.authoredSchemas()) text << " " << schema;
        for (const auto& name : prim.propertyNames(true)) text << " ." << name;
        text << "\n";
        return true;
    });
    return text.str();
}

const char* const kScene = R"(
def Xform "World" {
    def "Car" ( instanceable = true
        references = </Asset> ) {}
    def "Bus" ( instanceable = true
        references = </Asset> ) {}
    over "Ghost" {}
    def "Off" ( active = false ) { def "Below" {} }
}
class "Asset" { def Mesh "Wheel" { rel to = </Asset> } }
)";

}  // namespace

TEST(Stage, TraversesWhatThePredicateNames) {
    const Stage stage(layerOf(kScene));
    EXPECT_THAT(pathsOf(stage.traverse()), ElementsAre("/World", "/World/Car", "/World/Bus"));
    EXPECT_THAT(pathsOf(stage.traverse(PrimPredicate::all())),
                ElementsAre("/World", "/World/Car", "/World/Bus", "/World/Ghost", "/World/Off",
                            "/Asset", "/Asset/Wheel"));
    EXPECT_THAT(
        pathsOf(stage.traverse(PrimPredicate::normal().throughInstances())),
        ElementsAre("/World", "/World/Car", "/World/Car/Wheel", "/World/Bus", "/World/Bus/Wheel"));
    EXPECT_THAT(pathsOf(stage.traverse(PrimPredicate::all().with(PrimFlag::Defined, false))),
                IsEmpty());
}

TEST(Stage, InstancesShareAPrototypeAndShowItsPrimsAsTheirOwn) {
    const Stage stage(layerOf(kScene));
    const auto car = stage.prim(SdfPath("/World/Car")), bus = stage.prim(SdfPath("/World/Bus"));
    ASSERT_TRUE(car.prototype());
    EXPECT_EQ(car.prototype(), bus.prototype());
    EXPECT_EQ(stage.instances(car.prototype()).size(), 2u);
    EXPECT_THAT(car.children(), IsEmpty());
    for (const char* owner : {"/World/Car", "/World/Bus"}) {
        const auto wheel = stage.prim(SdfPath(owner).AppendChild(TfToken("Wheel")));
        ASSERT_TRUE(wheel);
        EXPECT_TRUE(wheel.isInstanceProxy());
        EXPECT_EQ(wheel.typeName(), "Mesh");
        EXPECT_EQ(wheel.parent().path(), SdfPath(owner));
        EXPECT_THAT(wheel.property(TfToken("to")).targets(), ElementsAre(SdfPath(owner)));
    }
    EXPECT_FALSE(stage.prim(SdfPath("/World/Car/Gone")));
}

TEST(Stage, HandlesOfPrimsStayValidUntilThePrimIsGone) {
    const auto layer = layerOf("def \"A\" { def \"B\" {} }");
    Prim left;
    {
        const Stage stage(layer);
        const auto a = stage.prim(SdfPath("/A")), b = stage.prim(SdfPath("/A/B"));
        layer->GetPrimAtPath(SdfPath("/A"))
            ->SetInfo(SdfFieldKeys->Kind, pxr::VtValue(TfToken("component")));
        EXPECT_TRUE(a && b) << "composed again at the same path";
        EXPECT_TRUE(a.has(PrimFlag::Model));
        layer->GetPrimAtPath(SdfPath("/A"))->RemoveNameChild(layer->GetPrimAtPath(SdfPath("/A/B")));
        EXPECT_TRUE(a);
        EXPECT_FALSE(b);
        EXPECT_FALSE(b.parent());
        left = a;
    }
    EXPECT_FALSE(left) << "its stage is gone";
}

TEST(Stage, AnEditOfAValueIsToldAsThatAndComposesNothing) {
    const auto layer = layerOf("def \"A\" { double v = 1 }\ndef \"B\" ( references = </A> ) {}");
    Stage stage(layer);
    StageChanges told;
    const auto kept = stage.subscribe([&](const StageChanges& changes) { told = changes; });
    const auto before = stage.primsUpdated();
    layer->GetAttributeAtPath(SdfPath("/A.v"))->SetDefaultValue(pxr::VtValue(2.0));
    EXPECT_EQ(stage.primsUpdated(), before);
    EXPECT_THAT(told.resynced, IsEmpty());
    ASSERT_EQ(told.changedInfo.size(), 2u);
    EXPECT_TRUE(told.changedInfo.at(SdfPath("/B.v")).contains(SdfFieldKeys->Default));
    EXPECT_EQ(stage.property(SdfPath("/B.v")).value(), pxr::VtValue(2.0));
}

TEST(Stage, ANewPrimIsToldAloneAndWhereverItIsReferenced) {
    const auto layer =
        layerOf("def \"A\" { def \"Old\" {} }\ndef \"B\" ( references = </A> ) {}\ndef \"C\" {}");
    Stage stage(layer);
    StageChanges told;
    auto kept = stage.subscribe([&](const StageChanges& changes) { told = changes; });
    pxr::SdfCreatePrimInLayer(layer, SdfPath("/A/New"));
    EXPECT_THAT(pathsOf(told.resynced), ElementsAre("/A/New", "/B/New"));
    EXPECT_TRUE(stage.prim(SdfPath("/B/New")));
    kept.reset();
    pxr::SdfCreatePrimInLayer(layer, SdfPath("/C/New"));
    EXPECT_THAT(pathsOf(told.resynced), ElementsAre("/A/New", "/B/New")) << "subscription ended";
    EXPECT_TRUE(stage.prim(SdfPath("/C/New")));
}

TEST(Stage, LoadsUnloadsMutesAndMasks) {
    const auto model = layerOf("def \"M\" { def \"Part\" {} }");
    const auto sub = layerOf("def \"S\" {}");
    const auto root =
        layerOf("( subLayers = [@" + sub->GetIdentifier() + "@] )\ndef \"A\" ( payload = @" +
                model->GetIdentifier() + "@</M> ) {}");
    Stage stage(root, {}, {.load = LoadRules::none()});
    const SdfPath part("/A/Part"), a("/A"), s("/S");
    EXPECT_FALSE(stage.prim(part));
    EXPECT_FALSE(stage.prim(a).has(PrimFlag::Loaded));
    stage.load(a);
    EXPECT_TRUE(stage.prim(part));
    EXPECT_TRUE(stage.prim(a).has(PrimFlag::Loaded));
    stage.unload(a);
    EXPECT_FALSE(stage.prim(part));
    stage.setLoadRules(LoadRules::all());
    EXPECT_TRUE(stage.prim(part));

    EXPECT_TRUE(stage.prim(s));
    stage.setMutedLayers({sub->GetIdentifier()});
    EXPECT_FALSE(stage.prim(s));
    stage.setMutedLayers({});
    EXPECT_TRUE(stage.prim(s));

    stage.setMask(PopulationMask({part}));
    EXPECT_THAT(pathsOf(stage.traverse()), ElementsAre("/A", "/A/Part"));
    stage.setMask({});
    EXPECT_TRUE(stage.prim(s));
}

// Pcp composes no prim again for specs without arcs, so the stage has to find what they change.
TEST(Stage, SpecsOfMutedLayersAreFollowed) {
    const auto root = layerOf("def \"A\" { def \"Below\" {} }\ndef \"B\" ( references = </A> ) {}");
    const auto weak = layerOf("over \"A\" ( active = false ) { custom int x = 1 }");
    const auto only = layerOf("over \"A\" { custom int y = 1 }");
    Stage stage(root);
    StageChanges told;
    const auto subscription = stage.subscribe([&](const StageChanges& one) { told = one; });
    const auto change = [&](auto&& edit) {
        told = {};
        edit();
        EXPECT_EQ(described(stage),
                  described(Stage(root, stage.sessionLayer(), {.muted = stage.mutedLayers()})));
        return pathsOf(told.resynced);
    };
    const auto add = [&] {
        root->SetSubLayerPaths({weak->GetIdentifier(), only->GetIdentifier()});
    };
    EXPECT_THAT(change(add), ElementsAre("/A", "/B"));
    EXPECT_FALSE(stage.prim(SdfPath("/B/Below")));
    EXPECT_THAT(change([&] { stage.setMutedLayers({weak->GetIdentifier()}); }),
                ElementsAre("/A", "/B"));
    EXPECT_TRUE(stage.prim(SdfPath("/B/Below")));
    EXPECT_THAT(change([&] { stage.setMutedLayers({}); }), ElementsAre("/A", "/B"));
    EXPECT_FALSE(stage.prim(SdfPath("/B/Below")));
    EXPECT_THAT(change([&] { stage.setMutedLayers({only->GetIdentifier()}); }),
                ElementsAre("/A.y", "/B.y"));
    EXPECT_THAT(change([&] { root->SetSubLayerPaths({}); }), ElementsAre("/A", "/B"));
}

TEST(Stage, AChildThatNoSpecNamesAnyMoreIsReported) {
    const auto root =
        layerOf("def \"A\" { over \"Child\" {} }\ndef \"B\" ( references = </A> ) {}");
    Stage stage(root);
    StageChanges told;
    const auto subscription = stage.subscribe([&](const StageChanges& one) { told = one; });
    ASSERT_TRUE(stage.prim(SdfPath("/B/Child")));
    root->GetPrimAtPath(SdfPath("/A"))->RemoveNameChild(root->GetPrimAtPath(SdfPath("/A/Child")));
    EXPECT_FALSE(stage.prim(SdfPath("/B/Child")));
    EXPECT_THAT(pathsOf(told.resynced), ElementsAre("/A/Child", "/B/Child"));
    EXPECT_THAT(told.changedInfo, IsEmpty());
}

// OpenUSD 26.8 reads freed memory when only the source of expression variables changes. The test
// overwrites memory that is freed, so that reading it ends the process.
TEST(Stage, VariablesOfAReferencedLayerCanComeFromTheStageInstead) {
    const auto asset = layerOf("def \"A\" { asset file }");
    asset->SetField(SdfPath("/A.file"), SdfFieldKeys->Default,
                    pxr::VtValue(pxr::SdfAssetPath("`\"./${WHICH}.png\"`")));
    const pxr::VtDictionary one{{"WHICH", pxr::VtValue("one")}},
        two{{"WHICH", pxr::VtValue("two")}};
    asset->SetExpressionVariables(one);
    const auto root = layerOf("def \"P\" ( references = @" + asset->GetIdentifier() + "@</A> ) {}");
    const Stage stage(root);
    const auto shown = [&] {
        return stage.property(SdfPath("/P.file")).value().Get<pxr::SdfAssetPath>().GetAssetPath();
    };
    EXPECT_EQ(shown(), "./one.png");
    mallopt(M_PERTURB, 165);
    root->SetExpressionVariables(one);
    mallopt(M_PERTURB, 0);
    EXPECT_EQ(shown(), "./one.png");
    root->SetExpressionVariables(two);
    EXPECT_EQ(shown(), "./two.png");
}

// Instances with equal keys can differ below, so the choice of the source can be seen.
TEST(Stage, APrototypeThatLosesItsSourceShowsAnOlderInstanceBeforeANewOne) {
    const auto root = layerOf(kScene);
    const Stage stage(root);
    const auto sourceOf = [&](const char* instance) {
        const auto wheel = stage.prim(SdfPath(instance)).prototype().child(TfToken("Wheel"));
        return wheel.primIndex().GetPath().GetParentPath();
    };
    const SdfPath old = sourceOf("/World/Car");
    const SdfPath other(old == SdfPath("/World/Car") ? "/World/Bus" : "/World/Car");
    {
        const pxr::SdfChangeBlock block;
        const auto world = root->GetPrimAtPath(SdfPath("/World"));
        world->RemoveNameChild(root->GetPrimAtPath(old));
        pxr::SdfCopySpec(root, other, root, SdfPath("/World/A"));
        world->SetTypeName("Scope");
        world->SetKind(TfToken("group"));
    }
    EXPECT_EQ(stage.instances(stage.prim(other).prototype()).size(), 2u);
    EXPECT_EQ(sourceOf("/World/A"), other);
}

TEST(Stage, EditTargetsMapPathsIntoVariantsAndAcrossArcs) {
    const auto asset = layerOf("def \"M\" { def \"Part\" {} }");
    const auto root = layerOf("def \"A\" ( references = @" + asset->GetIdentifier() +
                              "@</M> (offset = 10; scale = 2)\nvariants = { string v = \"on\" }"
                              "prepend variantSets = \"v\" ) { variantSet \"v\" = { \"on\" {} } }");
    Stage stage(root);
    const auto inside = EditTarget::inVariant(root, SdfPath("/A{v=on}"));
    EXPECT_EQ(inside.specPath(SdfPath("/A/New")), SdfPath("/A{v=on}New"));
    EXPECT_TRUE(inside.specPath(SdfPath("/B")).IsEmpty());
    ASSERT_TRUE(inside.primSpec(SdfPath("/A/New")));
    EXPECT_TRUE(stage.prim(SdfPath("/A/New")));

    const auto a = stage.prim(SdfPath("/A"));
    for (const auto& node : a.primIndex().GetNodeRange()) {
        if (node.GetArcType() != pxr::PcpArcTypeReference) continue;
        const EditTarget across(asset, node);
        EXPECT_EQ(across.specPath(SdfPath("/A/Part.x")), SdfPath("/M/Part.x"));
        EXPECT_DOUBLE_EQ(across.layerTime(14), 2);
    }
    EXPECT_EQ(stage.editTargetFor(root).specPath(SdfPath("/A")), SdfPath("/A"));
}

TEST(Stage, BadInputBecomesErrorsAndTheRestIsUsable) {
    const auto layer = layerOf(R"(
def "Good" { def "Child" {} }
def "Loop" ( references = </Loop> ) {}
def "Gone" ( references = @./gone.usda@ ) {}
def "Nothing" ( inherits = </No/Such> ) {}
)");
    Stage stage(layer);
    EXPECT_TRUE(stage.prim(SdfPath("/Good/Child")));
    std::set<std::string> types;
    for (const auto& error : stage.errors()) {
        types.insert(error.type);
        EXPECT_FALSE(error.message.empty());
    }
    EXPECT_TRUE(types.contains("ArcCycle"));
    EXPECT_TRUE(types.contains("InvalidAssetPath"));
    layer->GetPrimAtPath(SdfPath("/Loop"))->GetReferenceList().ClearEdits();
    types.clear();
    for (const auto& error : stage.errors()) types.insert(error.type);
    EXPECT_FALSE(types.contains("ArcCycle")) << "it is repaired";
}

TEST(Stage, PrimsThatAreTooDeepAreLeftOut) {
    auto layer = SdfLayer::CreateAnonymous(".usda");
    {
        const pxr::SdfChangeBlock block;
        SdfPath path = SdfPath::AbsoluteRootPath();
        for (int depth = 0; depth < 700; ++depth) path = path.AppendChild(TfToken("D"));
        pxr::SdfCreatePrimInLayer(layer, path);
    }
    const Stage stage(layer);
    EXPECT_EQ(stage.traverse(PrimPredicate::all()).size(), 512u);
    ASSERT_EQ(stage.errors().size(), 1u);
    EXPECT_EQ(stage.errors().front().type, "NamespaceTooDeep");
}

namespace {

// Edits layers at random: prims, arcs, metadata, properties and instances.
class RandomEdits {
public:
    RandomEdits(unsigned seed, std::vector<SdfLayerRefPtr> layers)
        : random_(seed), layers_(std::move(layers)) {}

    void edit() {
        const auto& layer = layers_[random_() % layers_.size()];
        const auto path = somePath();
        if (random_() % 5 == 0) return remove(layer, path);
        const auto prim = pxr::SdfCreatePrimInLayer(layer, path);
        if (!prim) return;
        prim->SetSpecifier(random_() % 4 ? pxr::SdfSpecifierDef : pxr::SdfSpecifierOver);
        switch (random_() % 12) {
            case 0:
                prim->SetTypeName(random_() % 2 ? "Xform" : "Mesh");
                break;
            case 1:
                prim->SetActive(random_() % 3 > 0);
                break;
            case 2:
                prim->SetSpecifier(pxr::SdfSpecifierClass);
                break;
            case 3:
                prim->SetKind(TfToken(random_() % 2 ? "group" : "component"));
                break;
            case 4:
            case 5:
                refer(prim);
                break;
            case 6:
                prim->GetReferenceList().ClearEdits();
                break;
            case 7:
                if (!isOfClass(path)) prim->GetInheritPathList().Prepend(SdfPath("/E"));
                break;
            case 8:
            case 9:
                prim->SetInstanceable(random_() % 4 > 0);
                break;
            case 10:
                prim->SetNameChildrenOrder({TfToken("B"), TfToken("A")});
                break;
            default:
                property(prim);
        }
    }

private:
    SdfPath somePath() {
        SdfPath path = SdfPath::AbsoluteRootPath();
        const unsigned depth = 1 + random_() % 3;
        for (unsigned i = 0; i < depth; ++i)
            path =
                path.AppendChild(TfToken(std::string(1, char('A' + random_() % (i == 0 ? 5 : 4)))));
        return path;
    }

    // The class /E has no arcs. If arcs formed cycles, the prims inside instances would depend on
    // the instance that the prototype shows.
    static bool isOfClass(const SdfPath& path) { return path.HasPrefix(SdfPath("/E")); }

    // Adds arcs from earlier names to later names only, so that they form no cycle.
    void refer(const pxr::SdfPrimSpecHandle& prim) {
        const auto& other = layers_.back();
        const bool outside = prim->GetLayer() != pxr::SdfLayerHandle(other);
        const char top = prim->GetPath().GetPrefixes().front().GetName()[0];
        if (isOfClass(prim->GetPath())) return;
        if (outside)
            prim->GetReferenceList().Prepend(
                {other->GetIdentifier(), SdfPath("/" + std::string(1, char('A' + random_() % 4)))});
        else if (top < 'D')
            prim->GetReferenceList().Prepend({"", SdfPath("/" + std::string(1, char(top + 1)))});
    }

    void property(const pxr::SdfPrimSpecHandle& prim) {
        if (!prim->GetProperties().empty() && random_() % 2)
            prim->RemoveProperty(prim->GetProperties().front());
        else if (!prim->GetLayer()->HasSpec(prim->GetPath().AppendProperty(TfToken("v"))))
            pxr::SdfAttributeSpec::New(prim, "v", pxr::SdfValueTypeNames->Double);
    }

    // Keeps the targets of references, because Pcp does not notice a target that did not exist
    // before.
    void remove(const SdfLayerRefPtr& layer, const SdfPath& path) {
        if (path.IsRootPrimPath()) return;
        if (const auto prim = layer->GetPrimAtPath(path))
            prim->GetRealNameParent()->RemoveNameChild(prim);
    }

    std::mt19937 random_;
    std::vector<SdfLayerRefPtr> layers_;
};

}  // namespace

TEST(Stage, FollowsAnyEditsToWhereANewStageWouldBe) {
    for (unsigned seed = 0; seed < usdlive::seedsOf(100); ++seed) {
        SCOPED_TRACE(seed);
        const auto asset = SdfLayer::CreateAnonymous(".usda"),
                   sub = SdfLayer::CreateAnonymous(".usda"),
                   root = SdfLayer::CreateAnonymous(".usda");
        root->InsertSubLayerPath(sub->GetIdentifier());
        for (const char* name : {"/A", "/B", "/C", "/D", "/E"})
            for (const auto& layer : {asset, root})
                pxr::SdfCreatePrimInLayer(layer, SdfPath(name))->SetSpecifier(pxr::SdfSpecifierDef);
        RandomEdits edits(seed, {root, sub, asset});
        Stage stage(root);
        for (int step = 0; step < 60; ++step) {
            pxr::TfErrorMark mark;
            if (step % 4 == 0) {
                const pxr::SdfChangeBlock block;
                edits.edit();
                edits.edit();
            } else {
                edits.edit();
            }
            mark.Clear();
            if (step % 3) continue;
            const Stage anew(root);
            ASSERT_EQ(described(stage), described(anew)) << "after step " << step;
        }
    }
}
