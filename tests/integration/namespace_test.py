"""Compares `usdlive.NamespaceEditor` with Usd.NamespaceEditor, and tests the functions that only it has."""

import os
import random

import namespace_oracle as oracle
import namespace_scenes as scenes
import pytest
import usdlive
from conftest import error_elsewhere, synced
from pxr import Sdf, Tf, Usd, Vt

SEEDS = int(os.environ.get("USDLIVE_NAMESPACE_SEEDS", "50"))


def stage_of(text: str) -> Usd.Stage:
    layer = Sdf.Layer.CreateAnonymous("test.usda")
    assert layer.ImportFromString(scenes.usda(text))
    return Usd.Stage.Open(layer)


def body(layer: Sdf.Layer) -> str:
    return layer.ExportToString()


# --- comparison with Usd.NamespaceEditor ---

def test_random_edits_come_to_the_same(tmp_path):
    """All results and their messages are equal. One comparison of layers in a hundred may differ, because Usd uses
    the instance that it composes first as the source of a prototype. USDLIVE_NAMESPACE_SEEDS sets the number of
    seeds."""
    compared = applied = 0
    verdicts, layers = [], []
    for seed in range(SEEDS):
        for comparison in oracle.random_comparisons(seed, tmp_path):
            compared += comparison.is_known
            applied += bool(comparison.ours[0])
            if difference := comparison.difference():
                (verdicts if difference.startswith("verdict") else layers).append((seed, comparison.edit, difference))
    assert not verdicts
    assert len(layers) * 100 <= compared, layers
    assert compared > 3 * SEEDS and applied > SEEDS


@pytest.mark.parametrize("seed", [
    115,  # Usd composes prims below an inactive one after a change of the session layer
    511, 545, 20257,  # paths to a prim that keeps opinions of other arcs were removed
    346, 20358,  # and paths to a prim that a relocate removed were kept
    20234, 20364, 20850,  # a path to a moved prim was deleted, because its new place is below a deleted prim
    20015, 20027, 20403,  # paths to a prim whose name a relocate takes away were kept
    20540, 20904, 40523,  # the same
    20574,  # the edit makes a prim active, and a path to its child was removed
])
def test_seeds_that_failed_once(seed, tmp_path):
    compared = [comparison.difference() for comparison in oracle.random_comparisons(seed, tmp_path)]
    assert len(compared) > 2 and not any(compared), compared


HAND_MADE = {
    "sublayers and all that leads there": scenes.Scene({
        "root.usda": scenes.usda("""
            over "World" { over "Chair" { double x = 2 } }
            def "User" ( prepend references = </World/Chair> prepend inherits = </World/Class> ) {
                rel r = [</World/Chair>, </World/Chair/Leg>, </World/Other>]
                double y.connect = </World/Chair.x>
                pathExpression e = "/World/Chair//* - /World/Chair/Leg"
                uniform token[] xformOpOrder = ["/World/Chair"]
            }""", 'subLayers = [@./sub.usda@]\ndefaultPrim = "World"'),
        "sub.usda": scenes.usda("""
            def "World" {
                class "Class" { rel r = </World/Class> }
                def "Chair" { double x = 1 def "Leg" {} }
                def "Other" ( prepend specializes = </World/Chair> ) {}
            }""")}, edits=[
        ("move", "/World/Chair", "/World/Stool"), ("move", "/World/Chair", "/Chair"),
        ("move", "/World/Chair", "/World/Other/Chair"), ("delete", "/World/Chair", ""),
        ("move", "/World/Class", "/World/Base"), ("move", "/World", "/Earth"), ("delete", "/World", ""),
        ("move", "/World/Chair.x", "/World/Chair.z"), ("move", "/World/Chair.x", "/World/Other.x"),
        ("delete", "/World/Chair.x", ""), ("move", "/World/Chair/Leg", "/World/Chair/Foot"),
        ("move", "/World/Chair", "/World/Other"), ("move", "/World/Chair", "/World/Chair"),
        ("move", "/World/Chair", "/World/Chair/Leg/Chair"), ("move", "/World", "/World/World"),
        ("move", "/World/Chair", "/Missing/Chair"), ("delete", "/Missing", ""), ("delete", "/World.none", ""),
        ("move", "/World/Chair", "/World/1 bad"), ("move", "/", "/World2"), ("delete", "relative", "")]),
    "arcs to another file": scenes.Scene({
        "root.usda": scenes.usda("""
            def "A" ( prepend references = @./asset.usda@</Asset> ) {
                over "Part" { double x = 3 }
                def "Own" {}
            }
            def "B" ( payload = @./asset.usda@</Asset> ) { rel r = </A/Part> }
            def "C" ( inherits = </A> ) {}
            def "D" ( prepend references = @./asset.usda@ instanceable = true ) { double own = 1 }
            def "E" ( prepend references = @./asset.usda@ instanceable = true ) {}"""),
        "asset.usda": scenes.usda("""
            def "Asset" {
                double p = 1
                def "Part" { double x = 1 rel r = </Asset/Part/Deep> def "Deep" {} }
                def "Second" {}
            }""", 'defaultPrim = "Asset"')}, edits=[
        ("move", "/A/Part", "/A/Piece"), ("move", "/A/Part", "/Part"), ("delete", "/A/Part", ""),
        ("move", "/B/Part", "/B/Piece"), ("delete", "/B/Part/Deep", ""), ("move", "/A/Own", "/B/Own"),
        ("move", "/A/Part", "/A/Second"), ("move", "/C/Part", "/C/Piece"), ("move", "/C/Own", "/C/New"),
        ("move", "/A/Part/Deep", "/A/Deep"), ("move", "/A.p", "/A.q"), ("delete", "/A/Part.x", ""),
        ("move", "/D/Part", "/D/Piece"), ("move", "/D", "/F"), ("move", "/D.own", "/D.mine"),
        ("move", "/A/Own", "/D/Own"), ("move", "/A/Own", "/D/Part/Own"), ("delete", "/D", ""), ("move", "/A", "/Z"),
        ("delete", "/__Prototype_1/Part", ""), ("move", "/A/Own", "/__Prototype_1/Own")]),
    "relocates": scenes.Scene({
        "root.usda": scenes.usda("""
            def "A" ( prepend references = @./asset.usda@</Asset> ) {}
            def "User" { rel r = [</A/Moved>, </A/Second>] }""",
            "relocates = { </A/Part>: </A/Moved>, </A/Second>: <> }"),
        "asset.usda": scenes.usda("""
            def "Asset" { def "Part" { def "Deep" {} } def "Second" {} def "Third" {} }""")}, edits=[
        ("move", "/A/Moved", "/A/Again"), ("move", "/A/Moved", "/A/Part"), ("delete", "/A/Moved", ""),
        ("move", "/A/Third", "/A/Part"), ("move", "/A/Third", "/A/Second"), ("move", "/A/Moved/Deep", "/A/Deep"),
        ("move", "/A/Third", "/A/Moved/Third"), ("move", "/A/Part", "/A/X"), ("move", "/A/Moved", "/Outside")]),
    "variants": scenes.Scene({
        "root.usda": scenes.usda("""
            def "Set" ( variants = { string look = "a" } prepend variantSets = "look" ) {
                def "Base" {}
                variantSet "look" = {
                    "a" { over "Base" { double x = 1 } def "Only" { rel r = [</Set/Base>, </Set/Only>] } double v = 1 }
                    "b" { def "Other" {} }
                }
            }
            def "User" { rel r = </Set/Only> }""")}, edits=[
        ("move", "/Set/Base", "/Set/New"), ("move", "/Set/Only", "/Set/New"), ("delete", "/Set/Only", ""),
        ("move", "/Set.v", "/Set.w"), ("move", "/Set", "/Group"), ("move", "/Set/Only", "/Only")]),
    "schemas": scenes.Scene({
        "root.usda": scenes.usda("""
            def Sphere "Ball" ( prepend apiSchemas = ["CollectionAPI:lights", "MaterialBindingAPI"] ) {
                double radius = 2
                custom string own = "x"
                rel material:binding = </Mat>
                rel collection:lights:includes = </Mat>
                uniform pathExpression collection:lights:membershipExpression = "/Mat//*"
            }
            def Material "Mat" {}
            def Xform "Empty" {}""")}, edits=[
        ("delete", "/Ball.radius", ""), ("delete", "/Ball.own", ""), ("move", "/Ball.own", "/Ball.radius"),
        ("move", "/Ball.own", "/Empty.visibility"), ("delete", "/Ball.collection:lights:includes", ""),
        ("move", "/Ball.material:binding", "/Empty.material:binding"), ("delete", "/Ball.extent", ""),
        ("move", "/Mat", "/Looks"), ("delete", "/Mat", ""), ("move", "/Ball.own", "/Ball.a:b")]),
    "a stage that depends on it": scenes.Scene({
        "root.usda": scenes.usda("""
            def "Model" { def "Part" { double x = 1 def "Deep" {} } def "Other" {} }"""),
        "user.usda": scenes.usda("""
            def "Shot" ( prepend references = @./root.usda@</Model> ) {
                over "Part" { double x = 5 }
                rel r = [</Shot/Part>, </Shot/Part/Deep>]
            }
            def "Direct" ( payload = @./root.usda@</Model/Part> ) {}""")}, dependents=("user.usda",), edits=[
        ("move", "/Model/Part", "/Model/Piece"), ("delete", "/Model/Part", ""), ("move", "/Model/Part", "/Part"),
        ("move", "/Model/Part/Deep", "/Model/Deep"), ("move", "/Model", "/Thing"), ("delete", "/Model", ""),
        ("move", "/Model/Part.x", "/Model/Part.y"), ("delete", "/Model/Part.x", ""),
        ("move", "/Model/Part.x", "/Model/Other.x")]),
}


@pytest.mark.parametrize("name", HAND_MADE)
def test_edits_made_by_hand_come_to_the_same(tmp_path, name):
    scene = HAND_MADE[name]
    for number, edit in enumerate(scene.edits):
        comparison = oracle.Comparison(scene, edit, tmp_path / str(number))
        assert comparison.is_known or edit[1] == edit[2], comparison.theirs
        assert not comparison.difference(), edit


def test_two_edits_in_a_row_come_to_the_same(tmp_path):
    """The second edit is validated against the composition after the first one."""
    for number, edits in enumerate([
            [("move", "/A/Part", "/A/Piece"), ("move", "/A/Piece", "/A/Part")],
            [("move", "/A/Part", "/A/Piece"), ("move", "/A/Piece/Deep", "/Deep")],
            [("delete", "/A/Part", ""), ("move", "/A/Own", "/A/Part")],
            [("move", "/A", "/Z"), ("move", "/Z/Part", "/Z/Own/Part")]]):
        pair = [oracle.Opened(HAND_MADE["arcs to another file"], tmp_path / f"{number}{kind}") for kind in "ab"]
        ours = usdlive.NamespaceEditor(pair[1].stage)
        for edit in edits:
            verdicts = []
            for opened, editor in zip(pair, (Usd.NamespaceEditor(pair[0].stage), ours)):
                scenes.add(editor, edit)
                verdicts.append(editor.CanApplyEdits().whyNot)
                if not verdicts[-1]:
                    assert editor.ApplyEdits()
                ours.ClearEdits()
            assert verdicts[0] == verdicts[1]
        assert pair[0].texts() == pair[1].texts()


def test_an_empty_mask_has_no_prim_to_edit():
    all_of_it = stage_of('def "A" {}')
    for mask, refusal in (([], "The prim to edit is not a valid prim"), (["/B"], "The prim to edit is not a valid prim"), (["/"], "")):
        masked = Usd.Stage.OpenMasked(all_of_it.GetRootLayer(), Usd.StagePopulationMask(mask))
        editor = usdlive.NamespaceEditor(masked)
        editor.DeletePrimAtPath("/A")
        result = editor.CanApplyEdits()
        assert ("" if result else result.whyNot) == refusal, mask


def test_properties_that_a_fallback_type_defines_stay():
    again = stage = stage_of('def Later "A" { double radius = 2 double mine = 1 }')
    for layer, names in ((None, None), (stage.GetSessionLayer(), ["Unheard", "Sphere"]), (stage.GetRootLayer(), ["Sphere"])):
        if layer:
            layer.pseudoRoot.SetInfo("fallbackPrimTypes", {"Later": Vt.TokenArray(names)})
            again = Usd.Stage.Open(stage.GetRootLayer(), stage.GetSessionLayer())
        for name in ("radius", "mine"):
            results = []
            for editor in (Usd.NamespaceEditor(again), usdlive.NamespaceEditor(again)):
                editor.DeletePropertyAtPath(f"/A.{name}")
                result = editor.CanApplyEdits()
                results.append((bool(result), "" if result else result.whyNot))
            assert results[0] == results[1], (names, name, results)
            assert results[0][0] == (name == "mine" or not layer), results


# --- functions that Usd.NamespaceEditor does not have ---

def test_a_batch_comes_to_what_its_edits_do_one_by_one(tmp_path):
    """The stages also have arcs. Undo restores all layers."""
    played = 0
    for seed in range(max(12, SEEDS // 4)):
        scene = scenes.random_scene(seed)
        choice = random.Random(seed)
        with oracle.quiet():
            single, batch = (oracle.open_scene(scene, tmp_path / f"{seed}{kind}") for kind in "ab")
            if not single or not batch:
                continue
            one, all_ = single.editor(usdlive.NamespaceEditor), batch.editor(usdlive.NamespaceEditor)
            before = batch.texts()
            for _ in range(4):
                edit = scenes.random_edits(single.stage, choice, 1)[0]
                scenes.add(one, edit)
                if one.ApplyEdits():
                    scenes.add(all_, edit)
            if len(all_.GetEdits()) < 2:
                continue
            played += 1
            assert all_.ApplyEdits(), f"seed {seed}: {all_.GetResult().whyNot}"
            assert batch.meant() == single.meant(), f"seed {seed}"
            assert all_.Undo() == []
            assert batch.texts() == before, f"seed {seed}"
    assert played > 5


def test_a_batch_is_applied_as_a_whole_or_not_at_all():
    stage = stage_of('def "A" {}\ndef "B" {}\n')
    editor = usdlive.NamespaceEditor(stage)
    before = body(stage.GetRootLayer())
    assert editor.MovePrimAtPath("/A", "/C") and editor.MovePrimAtPath("/A", "/D")
    result = editor.CanApplyEdits()
    assert not result and result.errors == [result.whyNot] and result.warnings == []
    assert result.whyNot == "Edit 2 of 2, </A> to </D>: The prim to edit is not a valid prim"
    assert editor.ApplyEdits() is False and not editor.GetResult()
    assert body(stage.GetRootLayer()) == before
    assert editor.GetEdits() == [] and editor.CanApplyEdits().whyNot == "There are no valid edits to perform"


def test_targets_follow_all_moves_of_a_batch():
    stage = stage_of('def "A" { double x = 1 }\ndef "B" {}\ndef "User" { rel r = [</A.x>, </B>] }\n')
    moves = []

    def note(notice, sender):
        moves.extend((str(path), str(stage.GetPrimAtPath(path))) for path in notice.GetResyncedPaths())

    key = Tf.Notice.Register(Usd.Notice.ObjectsChanged, note, stage)
    editor = usdlive.NamespaceEditor(stage)
    editor.MovePrimAtPath("/A", "/T")
    editor.MovePrimAtPath("/T", "/C")
    assert editor.GetLayersToEdit() == [stage.GetRootLayer()]
    assert editor.ApplyEdits()
    key.Revoke()
    assert {"/A", "/C"} <= {path for path, _ in moves} <= {"/A", "/T", "/C"}
    assert stage.GetRelationshipAtPath("/User.r").GetTargets() == [Sdf.Path("/C.x"), Sdf.Path("/B")]
    for old, new in [("/C", "/T"), ("/B", "/C"), ("/T", "/B")]:
        editor.MovePrimAtPath(old, new)
    assert editor.ApplyEdits()
    assert stage.GetRelationshipAtPath("/User.r").GetTargets() == [Sdf.Path("/B.x"), Sdf.Path("/C")]


def test_targets_stay_if_opinions_of_another_arc_keep_the_prim():
    """Usd.NamespaceEditor removes all of them."""
    stage = stage_of("""
        class "Class" { def "A" { double q = 1 def "X" {} } }
        class "Other" { def "A" { double p = 1 def "Y" {} } }
        def "World" ( prepend references = [</Class>, </Other>] ) {}
        def "User" {
            rel r = [</World/A>, </World/A/X>, </World/A/Y>, </World/A.p>, </World/A.q>, </Class/A>]
            pathExpression e = "/World/A//* + /World/A/X"
        }""")
    editor = usdlive.NamespaceEditor(stage)
    editor.DeletePrimAtPath("/Class/A")
    assert editor.ApplyEdits()
    assert [str(path) for path in stage.GetRelationshipAtPath("/User.r").GetTargets()] == [
        "/World/A", "/World/A/Y", "/World/A.p"]
    assert stage.GetAttributeAtPath("/User.e").Get() == Sdf.PathExpression("/World/A//*")
    assert editor.Undo() == [] and len(stage.GetRelationshipAtPath("/User.r").GetTargets()) == 6


def test_arcs_that_the_stage_does_not_compose_follow():
    """They are in variants that are not selected, and below inactive prims."""
    stage = stage_of("""
        class "Class" { double x = 1 class "Inner" { double x = 2 } }
        def "World" ( variants = { string look = "red" } prepend variantSets = "look" ) {
            def "Off" ( active = false ) { def "A" ( prepend references = </Class/Inner> ) {} }
            variantSet "look" = { "red" {} "blue" {
                def "B" ( prepend inherits = </Class> prepend specializes = </Class/Inner> payload = </Class> ) {} } }
        }""")
    before = body(stage.GetRootLayer())
    editor = usdlive.NamespaceEditor(stage)
    editor.MovePrimAtPath("/Class/Inner", "/Class/Part")
    editor.MovePrimAtPath("/Class", "/Base")
    assert editor.ApplyEdits()
    world = stage.GetPrimAtPath("/World")
    world.GetVariantSet("look").SetVariantSelection("blue")
    stage.GetPrimAtPath("/World/Off").SetActive(True)
    assert stage.GetAttributeAtPath("/World/B.x").Get() == 1 and stage.GetAttributeAtPath("/World/Off/A.x").Get() == 2
    written = body(stage.GetRootLayer())
    assert "inherits = </Base>" in written and "specializes = </Base/Part>" in written
    assert "payload = </Base>" in written and "Class" not in written
    stage.GetPrimAtPath("/World/Off").SetActive(False)
    world.GetVariantSet("look").SetVariantSelection("red")
    assert editor.Undo() == [] and body(stage.GetRootLayer()) == before
    editor.DeletePrimAtPath("/Class")
    assert editor.ApplyEdits() and "Class" not in body(stage.GetRootLayer())


def test_a_prim_cannot_move_below_a_prim_that_its_relocate_removes(tmp_path):
    """The relocate would remove /User/Part, because /User gets its children from /A. Usd.NamespaceEditor does it."""
    scene = scenes.Scene({
        "root.usda": scenes.usda("""
            def "A" ( prepend references = @./asset.usda@</Asset> ) {}
            def "User" ( prepend references = </A> ) {}"""),
        "asset.usda": scenes.usda('def "Asset" { def "Part" { def "Deep" {} } }')})
    opened = oracle.Opened(scene, tmp_path / "ours")
    before = opened.texts()
    editor = opened.editor(usdlive.NamespaceEditor)
    editor.MovePrimAtPath("/A/Part", "/User/Part/Deep/Part")
    assert editor.CanApplyEdits().whyNot == ("The prim to edit cannot be moved below </User/Part>, which the relocate of "
                                             "the edit would remove")
    assert not editor.ApplyEdits() and opened.texts() == before
    editor.MovePrimAtPath("/A/Part", "/User/Piece")
    assert editor.ApplyEdits() and opened.stage.GetPrimAtPath("/User/Piece/Deep")


def test_a_relocate_to_a_path_below_a_renamed_prim_follows(tmp_path):
    """Usd.NamespaceEditor leaves it, and the prim that it brings is gone."""
    scene = scenes.Scene({
        "root.usda": scenes.usda("""
            def "A" ( prepend references = @./asset.usda@</Asset> ) {}
            def "World" { over "Group" {} }
            def "User" { rel r = </World/Group/Moved> }""", "relocates = { </A/Part>: </World/Group/Moved> }"),
        "user.usda": scenes.usda("""
            def "Shot" ( prepend references = @./root.usda@</World> ) {}
            def "B" ( prepend references = @./asset.usda@</Asset> ) {}""",
            "relocates = { </B/Part>: </Shot/Group/Other> }"),
        "asset.usda": scenes.usda('def "Asset" { def "Part" {} }')}, dependents=("user.usda",))
    opened = oracle.Opened(scene, tmp_path / "ours")
    before = opened.texts()
    editor = opened.editor(usdlive.NamespaceEditor)
    editor.MovePrimAtPath("/World/Group", "/World/Set")
    assert editor.ApplyEdits()
    assert opened.stage.GetPrimAtPath("/World/Set/Moved") and opened.dependents[0].GetPrimAtPath("/Shot/Set/Other")
    assert opened.stage.GetRelationshipAtPath("/User.r").GetTargets() == ["/World/Set/Moved"]
    assert editor.Undo() == [] and opened.texts() == before


def test_a_prim_that_moves_below_what_the_edit_would_delete_stays():
    """/World/A is an opinion about the class that moves away from it. Usd.NamespaceEditor deletes it, and the moved prim
    that is then in it."""
    stage = stage_of("""
        class "Class" { class "A" { double x = 1 def "Part" {} } }
        def "World" ( prepend inherits = </Class> ) { over "A" { double y = 2 } }""")
    before = body(stage.GetRootLayer())
    editor = usdlive.NamespaceEditor(stage)
    editor.MovePrimAtPath("/Class/A", "/World/A/New")
    assert editor.ApplyEdits()
    assert stage.GetPrimAtPath("/World/A/New/Part") and stage.GetAttributeAtPath("/World/A/New.x").Get() == 1
    assert stage.GetAttributeAtPath("/World/A.y").Get() == 2
    assert editor.Undo() == [] and body(stage.GetRootLayer()) == before


@pytest.mark.parametrize("new", ["/B/C/A", "/S/T/A"])
def test_undo_keeps_overs_that_were_empty_before(tmp_path, new):
    scene = scenes.Scene({
        "root.usda": scenes.usda('def "A" { double x = 1 } over "B" { over "C" {} } over "S" {}',
                                 "subLayers = [@./sub.usda@]"),
        "sub.usda": scenes.usda('def "S" { def "T" {} }')})
    opened = oracle.Opened(scene, tmp_path / "ours")
    before = opened.texts()
    editor = opened.editor(usdlive.NamespaceEditor)
    editor.MovePrimAtPath("/A", new)
    assert editor.ApplyEdits() and opened.texts() != before
    assert editor.Undo() == [] and opened.texts() == before


def test_targets_go_if_a_relocate_takes_the_name_from_other_opinions(tmp_path):
    """The relocate is authored where the prim is inherited from. No child of that name remains, whatever has opinions
    about it. In a batch, each edit is compared with the stage as the edits before leave it."""
    scene = scenes.Scene({
        "root.usda": scenes.usda("""
            def "Class" ( prepend references = @./asset.usda@</Asset> ) {}
            def "Other" { def "Part" {} }
            def "World" ( prepend inherits = [</Class>, </Other>] ) { over "Part" {} }
            def "User" { rel r = [</World/Part>, </Other/Part>, </World>] }"""),
        "asset.usda": scenes.usda('def "Asset" { def "Part" {} }')})
    alone, batch = (oracle.Opened(scene, tmp_path / name) for name in ("alone", "batch"))
    editor = alone.editor(usdlive.NamespaceEditor)
    editor.DeletePrimAtPath("/Class/Part")
    assert editor.ApplyEdits()
    assert not alone.stage.GetPrimAtPath("/World/Part")
    assert alone.stage.GetRelationshipAtPath("/User.r").GetTargets() == ["/Other/Part", "/World"]
    editor = batch.editor(usdlive.NamespaceEditor)
    editor.DeletePrimAtPath("/Class/Part")
    editor.MovePrimAtPath("/Other", "/Second")
    editor.DeletePrimAtPath("/Second/Part")
    editor.MovePrimAtPath("/World", "/Earth")
    assert editor.ApplyEdits(), editor.GetResult().whyNot
    assert batch.stage.GetRelationshipAtPath("/User.r").GetTargets() == ["/Earth"]


def test_a_new_relocate_keeps_those_below_it(tmp_path):
    """Usd.NamespaceEditor drops the new relocate and reports success."""
    scene = scenes.Scene({
        "root.usda": scenes.usda('def "A" ( prepend references = @./asset.usda@</Asset> ) {}',
                                 "relocates = { </A/Part/Deep>: </A/Part/Low> }"),
        "asset.usda": scenes.usda('def "Asset" { def "Part" { def "Deep" {} def "Wide" {} } }')})
    opened = oracle.Opened(scene, tmp_path / "ours")
    editor = usdlive.NamespaceEditor(opened.stage)
    editor.MovePrimAtPath("/A/Part", "/A/Piece")
    assert editor.ApplyEdits()
    paths = [str(prim.GetPath()) for prim in opened.stage.TraverseAll()]
    assert paths == ["/A", "/A/Piece", "/A/Piece/Low", "/A/Piece/Wide"]


@pytest.mark.parametrize("what", ["a target", "an arc", "a relocate"])
def test_a_layer_that_cannot_be_edited_refuses_the_whole(tmp_path, what):
    root = {"a target": 'over "U" { rel r = </M> }', "an arc": 'def "U" ( prepend references = </M> ) {}',
            "a relocate": 'def "M2" ( prepend references = @./asset.usda@</Asset> ) {}'}[what]
    scene = scenes.Scene({
        "root.usda": scenes.usda(root, "subLayers = [@./sub.usda@]"), "sub.usda": scenes.usda('def "M" {}'),
        "asset.usda": scenes.usda('def "Asset" { def "Part" {} }')})
    opened = oracle.Opened(scene, tmp_path / "ours")
    opened.stage.GetRootLayer().SetPermissionToEdit(False)
    before = opened.texts()
    editor = usdlive.NamespaceEditor(opened.stage)
    old, new = ("/M2/Part", "/M2/Piece") if what == "a relocate" else ("/M", "/N")
    editor.MovePrimAtPath(old, new)
    result = editor.CanApplyEdits()
    assert "root.usda@" in result.whyNot and "is not editable" in result.whyNot
    assert editor.ApplyEdits() is False
    assert opened.texts() == before


def test_edits_within_variants():
    text = ('def "Set" ( variants = { string look = "a" } prepend variantSets = "look" ) {\n'
            '  variantSet "look" = { "a" { def "Chair" { double x = 1 } } "b" { def "Chair" { double x = 2 } } }\n}\n'
            'def "User" { rel r = </Set/Chair> }\n')
    stage = stage_of(text)
    editor = usdlive.NamespaceEditor(stage, usdlive.NamespaceEditor.EditOptions(editVariants=True))
    editor.RenamePrim(stage.GetPrimAtPath("/Set/Chair"), "Stool")
    assert editor.ApplyEdits()
    assert "relocates" not in body(stage.GetRootLayer())
    assert stage.GetRelationshipAtPath("/User.r").GetTargets() == [Sdf.Path("/Set/Stool")]
    for variant, value in (("a", 1), ("b", 2)):
        stage.GetPrimAtPath("/Set").GetVariantSet("look").SetVariantSelection(variant)
        assert stage.GetAttributeAtPath("/Set/Stool.x").Get() == value
    assert editor.Undo() == []
    assert stage.GetPrimAtPath("/Set/Chair")


# --- snippets from the documentation of Usd.NamespaceEditor ---

def run_snippet(code: str, **names) -> dict:
    """Runs the code with usdlive.NamespaceEditor in place of Usd.NamespaceEditor."""
    class Ours:
        Stage = Usd.Stage
        NamespaceEditor = usdlive.NamespaceEditor

    names["Usd"] = Ours
    exec(compile(code, "snippet", "exec"), names)  # noqa: S102 - the text belongs to the test
    return names


def test_the_snippets_of_the_documentation(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    scenes.Scene({
        "model.usda": '#usda 1.0\n(\n)\ndef Scope "modelScope" (\n)\n{\ndef "model1" (\n)\n{\n'
                      'custom string department = "department A"\n}\n}\n',
        "main.usda": '#usda 1.0\n(\nsubLayers = [\n@model.usda@\n]\n)\nover "modelScope" ()\n{\nover "model1" ()\n{\n'
                     'custom string department = "department N"\n}\n}\n'}).write(tmp_path)
    names = run_snippet('stage = Usd.Stage.Open("main.usda")\neditor = Usd.NamespaceEditor(stage)\n'
                        'removeResult = editor.DeletePrimAtPath("/modelScope/model1")\neditor.ApplyEdits()\n')
    assert names["removeResult"] and not names["stage"].GetPrimAtPath("/modelScope/model1")
    assert "model1" not in "".join(layer.ExportToString() for layer in names["stage"].GetLayerStack())

    # "Relocates will be available in a future update."
    scenes.Scene({
        "refModel.usda": '#usda 1.0\ndef "modelA" ()\n{\ndef "modelAChild" ()\n{\n}\n}\n',
        "main2.usda": '#usda 1.0\ndef "mainModelA" (\nprepend references = @refModel.usda@</modelA>\n)\n{\n}\n'
    }).write(tmp_path)
    names = run_snippet('stage = Usd.Stage.Open("main2.usda")\neditor = Usd.NamespaceEditor(stage)\n'
                        'removeResult = editor.MovePrimAtPath("/mainModelA/modelAChild", "/mainModelA/renamedChild")\n'
                        'editor.ApplyEdits()\n')
    assert [str(prim.GetPath()) for prim in names["stage"].Traverse()] == ["/mainModelA", "/mainModelA/renamedChild"]

    scenes.Scene({"big.usda": scenes.usda("""
        def "asset" { def "child1" {} def "Material1" {} def "charA" {} }
        def "Materials" {}
        def "model" { def "charA" { custom int customProperty = 1\ncustom int extraProperty = 2 } def "extraChar" {} }
        def "deprecated" { def "deprecatedChar" {} }
        def "oldAssets" { def "deprecated" { def "protoModel" {} } def "reviewed" {} }
        def "currentAssets" { def "model1" {} }
        def "groupA" { custom rel charA = </asset/charA> }
        def Sphere "testSphere" { custom string customProp = "custom property"\ndouble radius = 2 }""")}).write(tmp_path)
    names = run_snippet("""
stage = Usd.Stage.Open("big.usda")
editor = Usd.NamespaceEditor(stage)
# Delete a prim at a specific path
editor.DeletePrimAtPath("/asset/child1")
editor.ApplyEdits()
# Delete a UsdProperty
property = stage.GetPropertyAtPath("/model/charA.customProperty")
editor.DeleteProperty(property)
editor.ApplyEdits()
editor.MovePrimAtPath("/asset/Material1","/Materials/Material1")
editor.ApplyEdits()
editor.MovePropertyAtPath("/model/charA.extraProperty", "/model/charA.deprecatedProperty")
editor.ApplyEdits()
# Renames "/model/extraChar" to "/model/deprecatedChar"
renamedPrim = stage.GetPrimAtPath("/model/extraChar")
editor.RenamePrim(renamedPrim, "deprecatedChar")
editor.ApplyEdits()
reparentedProp = stage.GetPropertyAtPath("/model/charA.deprecatedProperty")
newParentPrim = stage.GetPrimAtPath("/deprecated/deprecatedChar")
editor.ReparentProperty(reparentedProp, newParentPrim, "deprecatedProperty")
editor.ApplyEdits()
editor.MovePrimAtPath("/asset/charA","/oldAssets/reviewed/charA")
editor.ApplyEdits()
# Start a batch of edits to remove deprecated assets and mark other
# assets as now deprecated
editor.DeletePrimAtPath("/oldAssets/deprecated/protoModel")
editor.MovePrimAtPath("/currentAssets/model1", "/oldAssets/model1")
batchApplyResult = editor.ApplyEdits() # Apply this batch of edits
editor.DeletePrimAtPath("/primDoesNotExist")
# Check first if we can delete /primDoesNotExist
canApplyResult = editor.CanApplyEdits()
if canApplyResult:
    editor.ApplyEdits()
else:
    # Handle error, using canApplyResult.whyNot as needed, etc.
    whyNot = canApplyResult.whyNot
refused = editor.ApplyEdits()
editor.DeletePropertyAtPath("/testSphere/customProp") # This is allowed
allowed = editor.ApplyEdits()
editor.DeletePropertyAtPath("/testSphere/radius") # This is not allowed and will cause an error
notAllowed = editor.ApplyEdits()
""")
    assert [str(prim.GetPath()) for prim in names["stage"].Traverse()] == [
        "/asset", "/Materials", "/Materials/Material1", "/model", "/model/charA", "/model/deprecatedChar",
        "/deprecated", "/deprecated/deprecatedChar", "/oldAssets", "/oldAssets/deprecated", "/oldAssets/reviewed",
        "/oldAssets/reviewed/charA", "/oldAssets/model1", "/currentAssets", "/groupA", "/testSphere"]
    assert names["batchApplyResult"] and names["whyNot"] == "The prim to edit is not a valid prim"
    assert names["refused"] is False and names["allowed"] is True and names["notAllowed"] is False
    assert names["stage"].GetRelationshipAtPath("/groupA.charA").GetTargets() == [Sdf.Path("/oldAssets/reviewed/charA")]
    assert names["stage"].GetPropertyAtPath("/deprecated/deprecatedChar.deprecatedProperty").Get() == 2


# --- bad input ---

def test_mistakes_are_errors_and_no_crash():
    stage = stage_of('def "A" {}\ndef "B" {}\n')
    editor = usdlive.NamespaceEditor(stage)
    with pytest.raises(TypeError):
        usdlive.NamespaceEditor(None)
    with pytest.raises(TypeError):
        editor.DeletePrimAtPath(None)
    with pytest.raises(TypeError):
        editor.RenamePrim(stage.GetPrimAtPath("/A"), None)
    with pytest.raises(usdlive.Error):
        editor.DeletePrim(Usd.Prim())
    with pytest.raises(usdlive.Error):
        editor.DeletePrim(stage_of('def "A" {}\n').GetPrimAtPath("/A"))
    for bad in ("", "A", "/", "/A.x", "/A{v=a}B", "/a b", "//", "/\udcff", "/" + "x/" * 20):
        with pytest.raises((Tf.ErrorException, UnicodeEncodeError)):
            editor.DeletePrimAtPath(bad)
        assert not editor.CanApplyEdits()
        editor.ClearEdits()
    assert "thread" in str(error_elsewhere(editor.CanApplyEdits))
    editor.MovePrimAtPath("/A", "/C")
    assert editor.ApplyEdits() and not editor.ApplyEdits()


def test_a_very_deep_path_is_refused():
    stage = stage_of('def "A" {}\n')
    editor = usdlive.NamespaceEditor(stage)
    deep = "/A" + "/B" * 20_000
    editor.DeletePrimAtPath(deep)
    assert editor.CanApplyEdits().whyNot == "The prim to edit is not a valid prim"
    editor.ClearEdits()
    editor.MovePrimAtPath("/A", deep)
    assert not editor.CanApplyEdits()


def test_a_stage_with_broken_arcs_and_cycles_can_be_edited(tmp_path):
    scene = scenes.Scene({"root.usda": scenes.usda("""
        def "A" ( prepend references = </A/B> ) { def "B" ( prepend inherits = </A> ) {} }
        def "C" ( prepend references = [@./missing.usda@, </Nowhere>] ) { def "D" {} }
        def "U" { rel r = </C/D> }""", "subLayers = [@./gone.usda@, @./root.usda@]")})
    with oracle.quiet():
        opened = oracle.Opened(scene, tmp_path / "ours")
        editor = usdlive.NamespaceEditor(opened.stage)
        editor.MovePrimAtPath("/C/D", "/C/E")
        editor.MovePrimAtPath("/C", "/F")
        assert editor.ApplyEdits(), editor.GetResult().whyNot
        assert opened.stage.GetRelationshipAtPath("/U.r").GetTargets() == [Sdf.Path("/F/E")]
        editor.MovePrimAtPath("/A/B", "/A/X")
        editor.CanApplyEdits()  # must not crash


# --- several editors of a live project ---

ROOT = """#usda 1.0
(
    subLayers = [@./sub.usda@]
)

def "World"
{
    def "Chair"
    {
        double x = 1
    }
    def "Table"
    {
        rel near = </World/Chair>
    }
}
"""
SUB = '#usda 1.0\n\nover "World"\n{\n    over "Chair"\n    {\n        double y = 1\n    }\n}\n'
EDIT = "import usdlive\ne = usdlive.NamespaceEditor(stage)\n"


@pytest.fixture
def two(project, serve, editor):
    (project / "root.usda").write_text(ROOT)
    (project / "sub.usda").write_text(SUB)
    server = serve(project)
    return server, editor(server, "ada", "root.usda"), editor(server, "bo", "root.usda")


def test_a_batch_is_one_transaction_over_all_layers(two):
    server, ada, bo = two
    before = ada.flush()
    ada.run(EDIT + "e.MovePrimAtPath('/World/Chair', '/World/Stool')\n"
            "e.MovePrimAtPath('/World/Stool', '/World/Table/Stool')\nassert e.ApplyEdits()")
    assert ada.flush() == before + 1
    root, sub = synced(server, ada, bo, layers=("root.usda", "sub.usda"))
    assert "</World/Table/Stool>" in root and '"Chair"' not in root and '"Chair"' not in sub and "y = 1" in sub
    ada.run("assert e.Undo() == []")
    assert ada.flush() == before + 2
    root, sub = synced(server, ada, bo, layers=("root.usda", "sub.usda"))
    assert "</World/Chair>" in root and '"Stool"' not in root + sub and "y = 1" in sub


def test_edits_that_did_not_know_of_a_batch_arrive_at_the_new_paths(two):
    server, ada, bo = two
    ada.run(EDIT + "e.MovePrimAtPath('/World/Chair', '/World/Stool')\ne.MovePrimAtPath('/World/Table', '/World/Desk')\n"
            "assert e.ApplyEdits()")
    bo.run("stage.GetPrimAtPath('/World/Chair').GetAttribute('x').Set(5.0)")
    ada.flush()
    root, _ = synced(server, ada, bo, layers=("root.usda", "sub.usda"))
    assert '"Stool"' in root and "x = 5" in root and '"Desk"' in root and "</World/Stool>" in root


@pytest.mark.parametrize("ours, theirs", [
    (["e.MovePrimAtPath('/World/Chair', '/World/Stool')"], ["e.MovePrimAtPath('/World/Chair', '/World/Seat')"]),
    (["e.MovePrimAtPath('/World/Chair', '/World/Stool')"], ["e.DeletePrimAtPath('/World/Chair')"]),
    (["e.DeletePrimAtPath('/World/Chair')"], ["e.MovePrimAtPath('/World/Table', '/World/Chair/Table')"]),
    (["e.MovePrimAtPath('/World/Chair', '/World/T')", "e.MovePrimAtPath('/World/Table', '/World/Chair')",
      "e.MovePrimAtPath('/World/T', '/World/Table')"],
     ["e.MovePrimAtPath('/World/Table', '/World/Chair/Table')", "e.MovePrimAtPath('/World/Chair', '/Chair')"]),
], ids=["rename, rename", "rename, delete", "delete, reparent", "batch, batch"])
def test_editors_who_did_not_know_of_each_other_end_with_the_same(two, ours, theirs):
    server, ada, bo = two
    for one, edits in ((ada, ours), (bo, theirs)):
        one.run(EDIT + "\n".join(edits) + "\nassert e.ApplyEdits(), e.GetResult().whyNot")
    ada.flush()
    synced(server, ada, bo, layers=("root.usda", "sub.usda"))
