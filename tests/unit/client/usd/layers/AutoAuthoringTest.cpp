// Tests auto authoring: each edit of the delegate goes to the layer where it belongs.
#include "usdlive/client/usd/layers/AutoAuthoring.h"

#include <pxr/base/vt/dictionary.h>
#include <pxr/usd/sdf/copyUtils.h>
#include <pxr/usd/sdf/namespaceEdit.h>
#include <pxr/usd/sdf/notice.h>
#include <pxr/usd/sdf/reference.h>
#include <pxr/usd/sdf/schema.h>
#include <pxr/usd/sdf/variantSetSpec.h>
#include <pxr/usd/sdf/variantSpec.h>

#include "LayersFixture.h"
#include "usd/content/SpecEdits.h"
#include "usdlive/client/usd/content/Recorder.h"

namespace usdlive::layers {

using pxr::SdfPath;

class AutoAuthoringTest : public LayersFixture {
protected:
    pxr::SdfLayerHandle start() {
        EXPECT_TRUE(layers().setEditMode(LayerEditMode::AutoAuthoring));
        frame();
        (void)layers().takeEvents();
        return target();
    }
};

TEST_F(AutoAuthoringTest, TheDelegateIsTheStrongestOfTheSessionAndTheEditTarget) {
    const auto delegate = start();
    EXPECT_NE(delegate->GetIdentifier().find("__DELTA_LAYER__"), std::string::npos);
    EXPECT_EQ(std::string(session->GetSubLayerPaths()[0]), delegate->GetIdentifier());
    EXPECT_TRUE(layers().autoAuthoring().isAutoAuthoringLayer(delegate->GetIdentifier()));
    const auto local = layers().state().localLayerIdentifiers(true, true, true);
    EXPECT_TRUE(std::ranges::find(local, delegate->GetIdentifier()) == local.end());

    host().setEditTarget(weak);
    frame();
    EXPECT_EQ(target(), delegate);
    session->RemoveSubLayerPath(0);
    frame();
    EXPECT_EQ(std::string(session->GetSubLayerPaths()[0]), delegate->GetIdentifier());

    EXPECT_TRUE(layers().setEditMode(LayerEditMode::Normal));
    EXPECT_EQ(session->GetNumSubLayerPaths(), 0u);
    EXPECT_EQ(target(), pxr::SdfLayerHandle(root));
}

TEST_F(AutoAuthoringTest, AnEditGoesToTheStrongestOpinionAndNothingElseChanges) {
    set(strong, "/A.x", 1);
    set(weak, "/A.x", 2);
    set(weak, "/A.y", 3);
    const auto delegate = start();
    set(delegate, "/A.x", 10);
    set(delegate, "/A.y", 30);
    EXPECT_EQ(get(strong, "/A.x"), 1) << "not before the frame";
    frame();
    EXPECT_EQ(get(strong, "/A.x"), 10);
    EXPECT_EQ(get(weak, "/A.x"), 2);
    EXPECT_EQ(get(weak, "/A.y"), 30) << "another property of a stronger layer does not attract it";
    EXPECT_FALSE(has(strong, "/A.y"));
    EXPECT_FALSE(has(root, "/A"));
}

TEST_F(AutoAuthoringTest, NewSpecsGoToTheDefaultLayer) {
    const auto delegate = start();
    EXPECT_EQ(layers().autoAuthoring().defaultLayer(), root->GetIdentifier());
    EXPECT_TRUE(layers().autoAuthoring().setDefaultLayer(weak->GetIdentifier()));
    const auto events = frameEvents();
    EXPECT_TRUE(find(events, LayerEventType::DefaultLayerChanged));
    EXPECT_EQ(refusal(layers().autoAuthoring().setDefaultLayer(session->GetIdentifier())),
              LayerErrorType::InvalidParam);
    EXPECT_EQ(refusal(layers().autoAuthoring().setDefaultLayer("nowhere.usda")),
              LayerErrorType::NotFound);
    for (int i = 0; i < 1000; ++i) define(delegate, "/P" + std::to_string(i));
    frame();
    EXPECT_EQ(weak->GetRootPrims().size(), 1000u);
    EXPECT_TRUE(root->GetRootPrims().empty());
}

TEST_F(AutoAuthoringTest, AnEmptyOverIsKeptOnlyIfItWasAuthored) {
    define(weak, "/A");
    const auto delegate = start();
    pxr::SdfCreatePrimInLayer(delegate, SdfPath("/Empty"));
    set(delegate, "/A.x", 1);
    frame();
    EXPECT_TRUE(has(root, "/Empty"));
    EXPECT_EQ(get(root, "/A.x"), 1) << "a new property";
}

TEST_F(AutoAuthoringTest, SamplesGoThroughTheOffsetOfTheLayerThatHasThem) {
    root->SetSubLayerOffset(pxr::SdfLayerOffset(10, 2), 1);
    set(weak, "/A.x", 0);
    weak->SetTimeSample(SdfPath("/A.x"), 1, 5.0);
    const auto delegate = start();
    set(delegate, "/A.x", 0);
    delegate->EraseField(SdfPath("/A.x"), pxr::SdfFieldKeys->Default);
    delegate->SetTimeSample(SdfPath("/A.x"), 30, 7.0);
    frame();
    const auto samples = weak->ListTimeSamplesForPath(SdfPath("/A.x"));
    EXPECT_EQ(samples, (std::set<double>{1, 10}));  // 10 * 2 + 10 = 30
    // The delegate has all samples, or it would hide those left out.
    EXPECT_EQ(delegate->ListTimeSamplesForPath(SdfPath("/A.x")), (std::set<double>{12, 30}));
    delegate->EraseTimeSample(SdfPath("/A.x"), 30);
    frame();
    EXPECT_EQ(weak->ListTimeSamplesForPath(SdfPath("/A.x")), (std::set<double>{1}));
}

TEST_F(AutoAuthoringTest, ADefaultBesideSamplesDoesNotHideThem) {
    set(weak, "/A.x", 0);
    weak->SetTimeSample(SdfPath("/A.x"), 1, 5.0);
    const auto delegate = start();
    set(delegate, "/A.x", 9);
    frame();
    EXPECT_EQ(get(weak, "/A.x"), 9);
    EXPECT_FALSE(delegate->HasField(SdfPath("/A.x"), pxr::SdfFieldKeys->Default));
    delegate->SetField(SdfPath("/A.x"), pxr::SdfFieldKeys->Default, pxr::SdfValueBlock());
    frame();
    EXPECT_EQ(weak->GetNumTimeSamplesForPath(SdfPath("/A.x")), 0u) << "a block stays a block";
}

TEST_F(AutoAuthoringTest, KeysOfOneDictionaryGoToTheirOwnLayers) {
    const auto& field = pxr::SdfFieldKeys->CustomData;
    define(strong, "/A");
    define(weak, "/A");
    const SdfPath path("/A");
    strong->SetFieldDictValueByKey(path, field, pxr::TfToken("s"), 1);
    weak->SetFieldDictValueByKey(path, field, pxr::TfToken("w"), 1);
    const auto delegate = start();
    pxr::SdfCreatePrimInLayer(delegate, path);
    delegate->SetFieldDictValueByKey(path, field, pxr::TfToken("s"), 2);
    delegate->SetFieldDictValueByKey(path, field, pxr::TfToken("w"), 3);
    frame();
    const auto at = [&](const pxr::SdfLayerRefPtr& layer, const char* key) {
        return layer->GetFieldDictValueByKey(path, field, pxr::TfToken(key)).GetWithDefault<int>(0);
    };
    EXPECT_EQ(at(strong, "s"), 2);
    EXPECT_EQ(at(weak, "w"), 3);
    EXPECT_EQ(at(strong, "w"), 0);
    // Setting a dictionary without a key removes the key.
    delegate->SetField(path, field, pxr::VtDictionary{{"s", pxr::VtValue(4)}});
    frame();
    EXPECT_EQ(at(strong, "s"), 4);
    EXPECT_EQ(at(weak, "w"), 0);
}

TEST_F(AutoAuthoringTest, AListOpIsComposedOverThatOfTheLayer) {
    define(weak, "/A");
    const auto prim = weak->GetPrimAtPath(SdfPath("/A"));
    prim->GetReferenceList().Prepend(pxr::SdfReference("a.usda"));
    const auto delegate = start();
    const auto over = pxr::SdfCreatePrimInLayer(delegate, SdfPath("/A"));
    over->GetReferenceList().Prepend(pxr::SdfReference("b.usda"));
    frame();
    EXPECT_EQ(prim->GetReferenceList().GetPrependedItems().size(), 2u);
    over->GetReferenceList().Remove(pxr::SdfReference("a.usda"));
    frame();
    ASSERT_EQ(prim->GetReferenceList().GetPrependedItems().size(), 1u);
    EXPECT_EQ(pxr::SdfReference(prim->GetReferenceList().GetPrependedItems()[0]).GetAssetPath(),
              "b.usda");
}

TEST_F(AutoAuthoringTest, AVisibleVariantIsEditedAndAnotherOneNotHidden) {
    define(weak, "/A");
    const auto prim = weak->GetPrimAtPath(SdfPath("/A"));
    prim->GetVariantSetNameList().Prepend("v");
    const auto variants = pxr::SdfVariantSetSpec::New(prim, "v");
    pxr::SdfVariantSpec::New(variants, "one");
    pxr::SdfVariantSpec::New(variants, "two");
    prim->SetVariantSelection("v", "one");
    set(weak, "/A{v=one}.x", 1);
    set(weak, "/A{v=two}.x", 2);
    const auto delegate = start();
    set(delegate, "/A.x", 5);
    frame();
    EXPECT_EQ(get(weak, "/A{v=one}.x"), 5);
    EXPECT_EQ(get(weak, "/A{v=two}.x"), 2);
    EXPECT_FALSE(has(weak, "/A.x"));
    EXPECT_FALSE(has(delegate, "/A.x"));

    set(delegate, "/A{v=two}.x", 7);
    frame();
    EXPECT_EQ(get(weak, "/A{v=two}.x"), 7) << "an edit of a variant stays inside";
}

TEST_F(AutoAuthoringTest, OnlyEditsOfTheWinningLayerRefreshTheMirror) {
    set(strong, "/A.x", 1);
    const auto delegate = start();
    set(delegate, "/A.x", 2);
    frame();
    set(weak, "/A.x", 50);
    frame();
    EXPECT_EQ(get(delegate, "/A.x"), 2);
    set(strong, "/A.x", 3);
    frame();
    EXPECT_EQ(get(delegate, "/A.x"), 3);
    set(root, "/A.x", 4);
    frame();
    EXPECT_EQ(get(delegate, "/A.x"), 4) << "a new winner";
    set(delegate, "/A.x", 5);
    frame();
    EXPECT_EQ(get(root, "/A.x"), 5);
    EXPECT_EQ(get(strong, "/A.x"), 3);
    root->RemoveSubLayerPath(0);
    frame();
    EXPECT_FALSE(has(delegate, "/A")) << "the stack is another one";
}

TEST_F(AutoAuthoringTest, APrimIsRemovedFromAllLayersAndAPropertyFromTheStrongest) {
    for (const auto& layer : {strong, weak}) set(layer, "/A/B.x", 1);
    const auto delegate = start();
    set(delegate, "/A/B.x", 2);
    frame();
    const auto prim = delegate->GetPrimAtPath(SdfPath("/A/B"));
    prim->RemoveProperty(delegate->GetPropertyAtPath(SdfPath("/A/B.x")));
    frame();
    EXPECT_FALSE(has(strong, "/A/B.x"));
    EXPECT_EQ(get(weak, "/A/B.x"), 1);
    define(delegate, "/A/B");
    frame();
    delegate->GetPrimAtPath(SdfPath("/A"))
        ->RemoveNameChild(delegate->GetPrimAtPath(SdfPath("/A/B")));
    frame();
    EXPECT_FALSE(has(strong, "/A/B"));
    EXPECT_FALSE(has(weak, "/A/B"));
}

TEST_F(AutoAuthoringTest, APrimIsRenamedInAllLayers) {
    set(weak, "/A.x", 1);
    const auto delegate = start();
    set(delegate, "/A.x", 2);
    frame();
    pxr::SdfBatchNamespaceEdit edits;
    edits.Add(SdfPath("/A"), SdfPath("/B"));
    ASSERT_TRUE(delegate->Apply(edits));
    set(delegate, "/B.x", 3);
    frame();
    EXPECT_FALSE(has(weak, "/A"));
    EXPECT_EQ(get(weak, "/B.x"), 3);
    EXPECT_FALSE(has(root, "/B"));
}

TEST_F(AutoAuthoringTest, AClosedLayerGetsNoEditsAndTheReasonIsReported) {
    set(weak, "/A.x", 1);
    const auto delegate = start();
    ASSERT_TRUE(layers().state().setLayerLockState(weak->GetIdentifier(), true));
    set(delegate, "/A.x", 2);
    const auto events = frameEvents();
    EXPECT_EQ(get(weak, "/A.x"), 1);
    EXPECT_FALSE(has(delegate, "/A.x"));
    const auto* refused = find(events, LayerEventType::EditsRefused);
    ASSERT_TRUE(refused);
    EXPECT_EQ(refused->paths, std::vector{SdfPath("/A.x")});
    ASSERT_EQ(layers().refusedEdits().size(), 1u);
    const auto& edit = layers().refusedEdits().front();
    EXPECT_EQ(edit.field, "default");
    EXPECT_EQ(edit.layer, weak->GetIdentifier());
    EXPECT_EQ(edit.type, LayerErrorType::ReadOnly);
    EXPECT_NE(edit.reason.find("locked"), std::string::npos);

    root->SetPermissionToEdit(false);
    define(delegate, "/New");
    const auto went = layers().distribute();
    ASSERT_EQ(went.size(), 1u) << "only of this call";
    EXPECT_EQ(went.front().path, SdfPath("/New"));
    EXPECT_EQ(went.front().type, LayerErrorType::ReadOnly);
    EXPECT_EQ(layers().refusedEdits().size(), 2u + 0u);
    EXPECT_FALSE(has(delegate, "/New"));
    root->SetPermissionToEdit(true);
}

TEST_F(AutoAuthoringTest, ARecorderGetsTheEditsOfTheLayersInsteadOfTheDelegate) {
    set(strong, "/A.x", 1);
    set(weak, "/A.y", 2);
    define(weak, "/Old/Below");
    const auto texts = [&] {
        std::vector<std::string> all(3);
        root->ExportToString(&all[0]);
        strong->ExportToString(&all[1]);
        weak->ExportToString(&all[2]);
        return all;
    };
    const auto delegate = start();
    set(delegate, "/Old.x", 1);
    layers().distribute();
    const auto before = texts();
    content::Recorder recorder;
    recorder.touch(delegate, SdfPath::AbsoluteRootPath(), true);
    set(delegate, "/A.x", 10);
    set(delegate, "/A.y", 20);
    set(delegate, "/New.x", 30);
    content::removeSpec(delegate, SdfPath("/Old"));
    layers().distribute(&recorder);
    EXPECT_EQ(get(weak, "/A.y"), 20);
    EXPECT_FALSE(has(weak, "/Old"));
    const auto record = recorder.finish();
    const std::vector<pxr::SdfLayerHandle> written = record.layers();
    EXPECT_TRUE(std::ranges::find(written, delegate) == written.end());

    set(root, "/New.hers", 1);  // somebody else
    const auto kept = record.undo([](const auto&) { return true; });
    EXPECT_TRUE(
        std::ranges::all_of(kept, [](const auto& one) { return one.path == SdfPath("/New"); }));
    EXPECT_EQ(get(root, "/New.hers"), 1);
    EXPECT_FALSE(has(root, "/New.x"));
    content::removeSpec(root, SdfPath("/New"));
    EXPECT_EQ(texts(), before);
    layers().distribute();
    EXPECT_EQ(get(delegate, "/A.x"), 1) << "the mirror follows";
}

TEST_F(AutoAuthoringTest, SuspendedEditsWait) {
    const auto delegate = start();
    layers().autoAuthoring().suspend();
    define(delegate, "/A");
    frame();
    EXPECT_FALSE(has(root, "/A"));
    layers().autoAuthoring().resume();
    frame();
    EXPECT_TRUE(has(root, "/A"));
    define(delegate, "/B");
    EXPECT_TRUE(layers().setEditMode(LayerEditMode::Normal));
    EXPECT_TRUE(has(root, "/B")) << "nothing is lost on leaving";
}

TEST_F(AutoAuthoringTest, AFrameIsOneChangeOfTheLayers) {
    set(strong, "/A.x", 1);
    set(weak, "/B.x", 1);
    const auto delegate = start();
    set(delegate, "/A.x", 2);
    set(delegate, "/B.x", 2);
    struct Counter : pxr::TfWeakBase {
        void changed(const pxr::SdfNotice::LayersDidChange&) { ++count; }
        int count = 0;
    } counter;
    const auto key = pxr::TfNotice::Register(pxr::TfCreateWeakPtr(&counter), &Counter::changed);
    frame();
    EXPECT_EQ(counter.count, 1);
    frame();
    EXPECT_EQ(counter.count, 1) << "afterwards nothing changes";
    auto copy = key;
    pxr::TfNotice::Revoke(copy);
}

// Sdf's own calls, as the ones of UsdStage: without an opinion in the delegate nothing is erased.
TEST_F(AutoAuthoringTest, OpinionsThatWereNotEditedAreClearedWithinClearing) {
    set(strong, "/A.x", 1);
    set(weak, "/A.x", 2);
    set(weak, "/A.y", 3);
    weak->SetTimeSample(SdfPath("/A.y"), 1.0, 10.0);
    weak->SetTimeSample(SdfPath("/A.y"), 2.0, 20.0);
    weak->SetFieldDictValueByKey(SdfPath("/A"), pxr::SdfFieldKeys->CustomData, pxr::TfToken("k"),
                                 pxr::VtValue(1));
    const auto delegate = start();
    const auto clearing = [&](const std::string& path, std::optional<double> time = {}) {
        return Clearing(layers().autoAuthoring(), {SdfPath(path)}, time);
    };
    {
        const auto nothing = clearing("/A.x");
        EXPECT_TRUE(delegate->HasField(SdfPath("/A.x"), pxr::SdfFieldKeys->Default));
    }
    EXPECT_FALSE(has(delegate, "/A")) << "what is left is taken back";
    {
        const auto one = clearing("/A.x");
        delegate->EraseField(SdfPath("/A.x"), pxr::SdfFieldKeys->Default);
    }
    {
        const auto sample = clearing("/A.y", 1.0);
        delegate->EraseTimeSample(SdfPath("/A.y"), 1.0);
    }
    {
        const auto key = clearing("/A");
        delegate->EraseFieldDictValueByKey(SdfPath("/A"), pxr::SdfFieldKeys->CustomData,
                                           pxr::TfToken("k"));
    }
    EXPECT_EQ(get(strong, "/A.x"), 1) << "not before the frame";
    frame();
    EXPECT_FALSE(strong->HasField(SdfPath("/A.x"), pxr::SdfFieldKeys->Default));
    EXPECT_EQ(get(weak, "/A.x"), 2) << "only the strongest opinion";
    EXPECT_EQ(weak->ListTimeSamplesForPath(SdfPath("/A.y")), std::set<double>{2.0});
    EXPECT_FALSE(weak->HasField(SdfPath("/A"), pxr::SdfFieldKeys->CustomData));
    {
        const auto property = clearing("/A.x");
        content::removeSpec(delegate, SdfPath("/A.x"));
    }
    frame();
    EXPECT_FALSE(has(strong, "/A.x"));
    EXPECT_TRUE(has(weak, "/A.x"));
    EXPECT_TRUE(layers().setEditMode(LayerEditMode::Normal));
    const auto nothing = clearing("/A.x");
}

}  // namespace usdlive::layers
