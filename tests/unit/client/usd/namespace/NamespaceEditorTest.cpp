// Tests namespace edits of layer stacks, by one editor and by several editors at once.
// tests/integration/namespace_test.py compares the results with Usd.NamespaceEditor.
#include "usdlive/client/usd/namespace/NamespaceEditor.h"

#include <gtest/gtest.h>
#include <malloc.h>
#include <pxr/usd/sdf/attributeSpec.h>
#include <pxr/usd/sdf/changeBlock.h>
#include <pxr/usd/sdf/primSpec.h>
#include <pxr/usd/sdf/reference.h>
#include <pxr/usd/sdf/relationshipSpec.h>
#include <pxr/usd/sdf/schema.h>

#include <algorithm>
#include <cstdlib>
#include <memory>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "unit/Seeds.h"
#include "unit/client/usd/MemoryServer.h"
#include "usd/editor/ClientInternals.h"
#include "usdlive/client/usd/Client.h"
#include "usdlive/client/usd/Misuse.h"
#include "usdlive/common/usd/SdfLayerStore.h"

namespace usdlive {
namespace {

using pxr::SdfLayer;
using pxr::SdfLayerRefPtr;
using pxr::SdfPath;
using tests::MemoryServer;

/// A stage with a root layer whose schemas define nothing.
class PlainStage final : public EditedStage {
public:
    explicit PlainStage(SdfLayerRefPtr root) : root_(std::move(root)) {}
    [[nodiscard]] pxr::SdfLayerHandle rootLayer() const override { return root_; }
    [[nodiscard]] pxr::SdfLayerHandle sessionLayer() const override { return {}; }
    [[nodiscard]] bool isBuiltIn(const pxr::TfToken&, const pxr::TfTokenVector&,
                                 const pxr::TfToken& property) const override {
        return property == "builtIn";
    }

private:
    const SdfLayerRefPtr root_;
};

SdfLayerRefPtr layerOfText(const std::string& text) {
    auto layer = SdfLayer::CreateAnonymous(".usda");
    EXPECT_TRUE(layer->ImportFromString("#usda 1.0\n" + text));
    return layer;
}

std::string layerText(const SdfLayerRefPtr& layer) {
    std::string text;
    layer->ExportToString(&text);
    return text;
}

std::unique_ptr<NamespaceEditor> editorOf(const SdfLayerRefPtr& root,
                                          NamespaceEditor::Options options = {}) {
    return std::make_unique<NamespaceEditor>(std::make_unique<PlainStage>(root), options);
}

const char* const kEditedScene =
    "def \"A\" {\n    def \"X\" {\n        double x = 1\n    }\n}\ndef \"B\" {\n    rel r = "
    "[</A/X>, </A>]\n}\n";

TEST(NamespaceEditor, AMoveAndWhatTargetsIt) {
    const auto root = layerOfText(kEditedScene);
    const auto editor = editorOf(root);
    EXPECT_TRUE(editor->MovePrimAtPath(SdfPath("/A/X"), SdfPath("/B/Y")));
    EXPECT_TRUE(editor->CanApplyEdits());
    EXPECT_TRUE(root->HasSpec(SdfPath("/A/X")));
    EXPECT_TRUE(editor->ApplyEdits());
    EXPECT_TRUE(root->HasSpec(SdfPath("/B/Y.x")));
    const auto targets = root->GetRelationshipAtPath(SdfPath("/B.r"))->GetTargetPathList();
    EXPECT_EQ(targets.GetExplicitItems()[0], SdfPath("/B/Y"));
    EXPECT_FALSE(editor->ApplyEdits());  // the batch is empty
}

TEST(NamespaceEditor, ABatchSeesWhatItHasDoneAndComesToTheLeast) {
    const auto root = layerOfText(kEditedScene);
    const auto editor = editorOf(root);
    editor->MovePrimAtPath(SdfPath("/A"), SdfPath("/T"));
    editor->MovePrimAtPath(SdfPath("/B"), SdfPath("/A"));
    editor->MovePrimAtPath(SdfPath("/T"), SdfPath("/B"));
    const auto result = editor->ApplyEdits();
    EXPECT_TRUE(result) << result.whyNot();
    EXPECT_TRUE(root->HasSpec(SdfPath("/B/X.x")));
    const auto targets = root->GetRelationshipAtPath(SdfPath("/A.r"))->GetTargetPathList();
    EXPECT_EQ(targets.GetExplicitItems()[0], SdfPath("/B/X"));
    EXPECT_EQ(targets.GetExplicitItems()[1], SdfPath("/B"));
}

TEST(NamespaceEditor, ABatchThatComesToNothingChangesNothing) {
    const auto root = layerOfText(kEditedScene);
    const auto before = layerText(root);
    const auto editor = editorOf(root);
    editor->MovePrimAtPath(SdfPath("/A"), SdfPath("/T"));
    editor->MovePrimAtPath(SdfPath("/T"), SdfPath("/A"));
    EXPECT_TRUE(editor->ApplyEdits());
    EXPECT_EQ(layerText(root), before);
}

TEST(NamespaceEditor, ABatchIsRefusedAsAWhole) {
    const auto root = layerOfText(kEditedScene);
    const auto before = layerText(root);
    const auto editor = editorOf(root);
    editor->MovePrimAtPath(SdfPath("/A"), SdfPath("/T"));
    editor->MovePrimAtPath(SdfPath("/A/X"), SdfPath("/T/Y"));  // no longer exists
    const auto result = editor->ApplyEdits();
    EXPECT_EQ(result.whyNot(),
              "Edit 2 of 2, </A/X> to </T/Y>: The prim to edit is not a valid prim");
    EXPECT_EQ(layerText(root), before);
}

TEST(NamespaceEditor, ALockedLayerThatOnlyATargetIsInRefusesTheEdit) {
    const auto root = layerOfText(kEditedScene),
               sub = layerOfText("over \"B\" {\n rel s = </A>\n}\n");
    root->InsertSubLayerPath(sub->GetIdentifier());
    sub->SetPermissionToEdit(false);
    const auto before = layerText(root);
    const auto editor = editorOf(root);
    editor->MovePrimAtPath(SdfPath("/A"), SdfPath("/T"));
    EXPECT_EQ(editor->CanApplyEdits().whyNot(),
              "The field targetPaths of @" + sub->GetIdentifier() +
                  "@</B.s> cannot be edited because the layer is not editable");
    EXPECT_FALSE(editor->ApplyEdits());
    EXPECT_EQ(layerText(root), before);
}

TEST(NamespaceEditor, UndoBringsBackAllOfIt) {
    const auto root = layerOfText(kEditedScene);
    const auto before = layerText(root);
    const auto editor = editorOf(root);
    editor->MovePrimAtPath(SdfPath("/A/X"), SdfPath("/B/Y"));
    editor->DeletePrimAtPath(SdfPath("/A"));
    editor->MovePrimAtPath(SdfPath("/B"), SdfPath("/C"));
    const auto result = editor->ApplyEdits();
    ASSERT_TRUE(result) << result.whyNot();
    EXPECT_TRUE(root->HasSpec(SdfPath("/C/Y.x")));
    EXPECT_FALSE(root->HasSpec(SdfPath("/A")));
    EXPECT_TRUE(editor->GetRecord().undo([](const auto&) { return false; }).empty());
    EXPECT_EQ(layerText(root), before);
}

TEST(NamespaceEditor, UndoInASharedLayerKeepsWhatOthersWrote) {
    const auto root = layerOfText(kEditedScene);
    const auto editor = editorOf(root);
    editor->MovePrimAtPath(SdfPath("/A"), SdfPath("/T"));
    ASSERT_TRUE(editor->ApplyEdits());
    root->GetAttributeAtPath(SdfPath("/T/X.x"))->SetDefaultValue(pxr::VtValue(7.0));
    const pxr::SdfPathVector other{SdfPath("/Other")};
    root->GetRelationshipAtPath(SdfPath("/B.r"))->GetTargetPathList().GetExplicitItems() = other;
    const auto kept = editor->GetRecord().undo([](const auto&) { return true; });
    EXPECT_EQ(root->GetField(SdfPath("/A/X.x"), pxr::TfToken("default")), pxr::VtValue(7.0));
    // Lists are merged item by item.
    const pxr::SdfPathVector items =
        root->GetRelationshipAtPath(SdfPath("/B.r"))->GetTargetPathList().GetExplicitItems();
    EXPECT_EQ(items, (pxr::SdfPathVector{SdfPath("/A/X"), SdfPath("/A"), SdfPath("/Other")}));
    EXPECT_TRUE(kept.empty());
}

TEST(NamespaceEditor, VariantsAreEditedInPlaceAsAnOption) {
    const std::string scene =
        "def \"Set\" (\n    variants = {\n        string look = \"a\"\n    }\n    prepend "
        "variantSets = \"look\"\n) {\n    variantSet \"look\" = {\n        \"a\" {\n            "
        "def "
        "\"Chair\" {\n            }\n        }\n        \"b\" {\n            def \"Chair\" {\n"
        "            }\n        }\n    }\n}\ndef \"B\" {\n    rel r = </Set/Chair>\n}\n";
    const auto root = layerOfText(scene);
    const auto editor = editorOf(root, {.editVariants = true});
    editor->RenamePrim(SdfPath("/Set/Chair"), pxr::TfToken("Stool"));
    const auto result = editor->ApplyEdits();
    ASSERT_TRUE(result) << result.whyNot();
    EXPECT_TRUE(root->HasSpec(SdfPath("/Set{look=a}Stool")));
    EXPECT_TRUE(root->HasSpec(SdfPath("/Set{look=b}Stool")));
    EXPECT_FALSE(root->HasRelocates());
    EXPECT_EQ(
        root->GetRelationshipAtPath(SdfPath("/B.r"))->GetTargetPathList().GetExplicitItems()[0],
        SdfPath("/Set/Stool"));

    const auto other = layerOfText(scene);
    const auto plain = editorOf(other);
    plain->RenamePrim(SdfPath("/Set/Chair"), pxr::TfToken("Stool"));
    ASSERT_TRUE(plain->ApplyEdits());
    EXPECT_TRUE(other->HasRelocates());

    const auto outside = editorOf(root, {.editVariants = true});
    outside->MovePrimAtPath(SdfPath("/Set/Stool"), SdfPath("/Stool"));
    EXPECT_EQ(outside->CanApplyEdits().whyNot().substr(0, 10), "The spec @");
}

TEST(NamespaceEditor, InvalidPathsAreNoEdits) {
    const auto root = layerOfText(kEditedScene);
    const auto editor = editorOf(root);
    for (const char* path : {"A", "/", "/A.x", "/Set{look=a}Chair", ""}) {
        EXPECT_FALSE(editor->DeletePrimAtPath(SdfPath(std::string(path)))) << path;
        EXPECT_EQ(editor->invalid(), std::string("Invalid path '") + path +
                                         "' provided as the source for a prim namespace edit.");
    }
    EXPECT_EQ(editor->CanApplyEdits().whyNot(), "There are no valid edits to perform");
    editor->ClearEdits();
    EXPECT_FALSE(editor->DeletePropertyAtPath(SdfPath("/A")));
    EXPECT_FALSE(editor->MovePrimAtPath(SdfPath("/A"), SdfPath("/")));
}

TEST(NamespaceEditor, AnotherThreadIsTurnedAway) {
    const auto root = layerOfText(kEditedScene);
    const auto editor = editorOf(root);
    bool turnedAway = false;
    std::thread([&] {
        try {
            editor->ApplyEdits();
        } catch (const Misuse&) {
            turnedAway = true;
        }
    }).join();
    EXPECT_TRUE(turnedAway);
}

/// Renames, moves and deletes prims, and writes values and targets, at random.
class RandomNamespace {
public:
    RandomNamespace(SdfLayerRefPtr layer, unsigned seed)
        : layer_(std::move(layer)), editor_(editorOf(layer_)), random_(seed) {}

    void step() {
        const auto prims = pathsOf([](const SdfPath& path) { return path.IsPrimPath(); });
        if (prims.empty() || pick(4) == 0) return create(prims);
        if (pick(2) == 0) return write(prims);
        const std::size_t edits = 1 + pick(3);
        for (std::size_t i = 0; i < edits; ++i) addEdit(prims);
        if (!editor_->ApplyEdits()) editor_->ClearEdits();
        if (pick(4) == 0) (void)editor_->GetRecord().undo([](const auto&) { return true; });
    }

private:
    std::size_t pick(std::size_t count) { return random_() % count; }
    pxr::TfToken name() { return pxr::TfToken(std::string(1, char('A' + pick(6)))); }
    template <class Wanted>
    std::vector<SdfPath> pathsOf(const Wanted& wanted) {
        std::vector<SdfPath> paths;
        layer_->Traverse(SdfPath::AbsoluteRootPath(), [&](const SdfPath& path) {
            if (wanted(path)) paths.push_back(path);
        });
        std::ranges::sort(paths);
        return paths;
    }
    SdfPath parent(const std::vector<SdfPath>& prims) {
        return prims.empty() || pick(3) == 0 ? SdfPath::AbsoluteRootPath()
                                             : prims[pick(prims.size())];
    }

    void create(const std::vector<SdfPath>& prims) {
        const SdfPath path = parent(prims).AppendChild(name());
        if (path.GetPathElementCount() > 4) return;
        pxr::SdfCreatePrimInLayer(layer_, path)->SetSpecifier(pxr::SdfSpecifierDef);
    }
    void write(const std::vector<SdfPath>& prims) {
        const auto prim = layer_->GetPrimAtPath(prims[pick(prims.size())]);
        if (pick(2) == 0) {
            const SdfPath path = prim->GetPath().AppendProperty(pxr::TfToken("r"));
            if (!layer_->HasSpec(path)) pxr::SdfRelationshipSpec::New(prim, "r", true);
            layer_->GetRelationshipAtPath(path)->GetTargetPathList().Add(prims[pick(prims.size())]);
        } else {
            const SdfPath path = prim->GetPath().AppendProperty(pxr::TfToken("x"));
            if (!layer_->HasSpec(path))
                pxr::SdfJustCreatePrimAttributeInLayer(layer_, path,
                                                       pxr::SdfValueTypeNames->Double);
            layer_->SetField(path, pxr::TfToken("default"), pxr::VtValue(double(pick(100))));
        }
    }
    void addEdit(const std::vector<SdfPath>& prims) {
        const SdfPath path = prims[pick(prims.size())];
        if (pick(5) == 0)
            editor_->DeletePrimAtPath(path);
        else if (pick(2) == 0)
            editor_->MovePrimAtPath(path, path.ReplaceName(name()));
        else
            editor_->MovePrimAtPath(path, parent(prims).AppendChild(name()));
    }

    const SdfLayerRefPtr layer_;
    const std::unique_ptr<NamespaceEditor> editor_;
    std::mt19937 random_;
};

LayerDoc docOfText(const std::string& text) {
    class Blobs final : public BlobSink {
        [[nodiscard]] bool wantsBlob(const Hash&) override { return false; }
        void keepBlob(const Hash&, SharedBytes) override {}
    } none;
    return *usd::readLayer(layerOfText(text), none);
}

SdfPath deepPath(int depth) {
    SdfPath path = SdfPath::AbsoluteRootPath();
    for (int i = 0; i < depth; ++i) path = path.AppendChild(pxr::TfToken("d"));
    return path;
}

// Expects that the prims of `C` can be edited, one by one and in a batch, and that </A/Part> is
// refused with a reason.
void expectEditableWithout(NamespaceEditor& editor, const std::string& reason) {
    const auto move = [&](const char* from, const char* to) {
        EXPECT_TRUE(editor.MovePrimAtPath(SdfPath(from), SdfPath(to)));
    };
    move("/C", "/D");
    EXPECT_EQ(editor.ApplyEdits().whyNot(), "");
    move("/D", "/E");
    move("/E/P", "/P");
    EXPECT_EQ(editor.ApplyEdits().whyNot(), "");
    move("/P", "/E/P");
    move("/E", "/C");
    EXPECT_EQ(editor.ApplyEdits().whyNot(), "");
    for (const auto& batch : {std::vector<const char*>{}, std::vector<const char*>{"/C", "/D"}}) {
        if (!batch.empty()) move(batch[0], batch[1]);
        move("/A/Part", "/A/Q");
        const auto whyNot = editor.ApplyEdits().whyNot();
        EXPECT_NE(whyNot.find("The prim to edit is not a valid prim: "), std::string::npos)
            << whyNot;
        EXPECT_NE(whyNot.find(reason), std::string::npos) << whyNot;
    }
}

TEST(NamespaceEditor, PrimsWhoseArcsLeadTooDeepAreRefusedAndTheRestIsEdited) {
    for (const int depth : {513, 30'000, 65'541})
        for (const char* kind : {"reference", "inherit"}) {
            SCOPED_TRACE(std::string(kind) + " of " + std::to_string(depth));
            const auto layer = layerOfText(
                "def \"A\" {\n def \"Part\" {\n}\n}\ndef \"C\" {\n def \"P\" {\n}\n rel r = "
                "</C/P>\n}\n");
            NamespaceEditor followed(std::make_unique<PlainStage>(layer));
            followed.Prepare();
            const auto part = layer->GetPrimAtPath(SdfPath("/A/Part"));
            if (*kind == 'r')
                part->GetReferenceList().Prepend(pxr::SdfReference("", deepPath(depth)));
            if (*kind == 'i') part->GetInheritPathList().Prepend(deepPath(depth));
            layer->SetField(SdfPath("/C.r"), pxr::SdfFieldKeys->TargetPaths,
                            pxr::VtValue(pxr::SdfPathListOp::CreateExplicit(
                                {SdfPath("/C/P"), deepPath(depth)})));
            expectEditableWithout(followed, std::to_string(depth) + " elements");
            NamespaceEditor opened(std::make_unique<PlainStage>(layer));
            expectEditableWithout(opened, std::to_string(depth) + " elements");
        }
}

// An arc that leads too deep is added below a prim that is renamed in the same notice.
TEST(NamespaceEditor, AnArcThatLeadsTooDeepIsFoundBelowARenamedPrim) {
    const auto layer =
        layerOfText("def \"A\" {\n def \"Part\" {\n}\n}\ndef \"C\" {\n def \"P\" {\n}\n}\n");
    NamespaceEditor editor(std::make_unique<PlainStage>(layer));
    editor.Prepare();
    {
        const pxr::SdfChangeBlock block;
        layer->GetPrimAtPath(SdfPath("/A/Part"))
            ->GetReferenceList()
            .Prepend(pxr::SdfReference("", deepPath(30'000)));
        layer->GetPrimAtPath(SdfPath("/A"))->SetName("B");
    }
    layer->GetPrimAtPath(SdfPath("/B"))->SetName("A");
    expectEditableWithout(editor, "30000 elements");
}

// OpenUSD 26.8 reads freed memory when only the source of expression variables changes. The test
// overwrites memory that is freed, so that reading it ends the process.
TEST(NamespaceEditor, VariablesOfAReferencedLayerCanComeFromTheStageInstead) {
    const auto asset = layerOfText("def \"A\" {\n def \"B\" {\n}\n}\n");
    const pxr::VtDictionary variables{{"WHICH", pxr::VtValue("one")}};
    asset->SetExpressionVariables(variables);
    const auto root =
        layerOfText("def \"P\" (\n references = @" + asset->GetIdentifier() + "@</A>\n) {\n}\n");
    NamespaceEditor editor(std::make_unique<PlainStage>(root));
    editor.Prepare();
    mallopt(M_PERTURB, 165);
    root->SetExpressionVariables(variables);
    mallopt(M_PERTURB, 0);
    editor.MovePrimAtPath(SdfPath("/P/B"), SdfPath("/P/C"));
    EXPECT_EQ(editor.ApplyEdits().whyNot(), "");
    EXPECT_EQ(root->GetRelocates(), (pxr::SdfRelocates{{SdfPath("/P/B"), SdfPath("/P/C")}}));
}

// Mixes renames with edits, renames, deletes and batches of other editors, while connections are
// lost.
TEST(NamespaceEditor, EditorsWhoEditTheNamespaceAtOnceConverge) {
    const char* const wanted = std::getenv("USDLIVE_NAMESPACE_SEEDS");
    const unsigned seeds = wanted ? unsigned(std::atoi(wanted)) : seedsOf(60);
    const LayerId id{"root.usda"};
    for (unsigned seed = 0; seed < seeds; ++seed) {
        SCOPED_TRACE(seed);
        std::mt19937 random(seed);
        MemoryServer server({{id, docOfText(kEditedScene)}});
        std::vector<std::unique_ptr<Client>> clients;
        std::vector<SdfLayerRefPtr> layers;
        std::vector<std::unique_ptr<RandomNamespace>> editors;
        for (unsigned i = 0; i < 3; ++i) {
            Client::Options options;
            options.user = "user" + std::to_string(i);
            clients.push_back(
                std::move(*client::ClientInternals::connectBy(server.connect(), options)));
            layers.push_back(*clients.back()->openLayer(id));
            editors.push_back(std::make_unique<RandomNamespace>(layers.back(), unsigned(random())));
        }
        for (int step = 0; step < 60; ++step) {
            editors[random() % editors.size()]->step();
            if (random() % 2) clients[random() % clients.size()]->tick();
            if (random() % 40 == 0) server.setReachable(false);
            if (random() % 15 == 0) server.setReachable(true);
        }
        server.setReachable(true);
        for (int round = 0; round < 3; ++round)
            for (const auto& client : clients) ASSERT_TRUE(client->flush(5000));
        for (const auto& layer : layers) EXPECT_EQ(layerText(layer), layerText(layers[0]));
        if (testing::Test::HasFailure()) return;
    }
}

}  // namespace
}  // namespace usdlive
