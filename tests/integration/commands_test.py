"""Tests commands, their undo and Kit's layer commands, on files and live."""

import logging
import inspect
import os
import random
import shutil
import sys
import types

import pytest
from conftest import wait_frames
from pxr import Sdf, Usd, UsdGeom

from usdlive.omni import usd as omni_usd
from usdlive.omni._registers import Recorder, make_like
from usdlive.omni.kit import app, commands, undo
from usdlive.omni.kit.usd.layers import LayerEditMode, LayerUtils, get_layers

ROOT = """#usda 1.0
(
    subLayers = [
        @./strong.usda@ (offset = 10; scale = 2),
        @./weak.usda@
    ]
)

def Xform "World"
{
    def Sphere "Ball"
    {
        double radius = 1
        asset texture = @./textures/ball.png@
        asset library = @Library.mdl@
    }

    def Cube "Box"
    {
    }
}
"""
STRONG = """#usda 1.0

over "World"
{
    over "Ball"
    {
        double radius = 2
        double size.timeSamples = {
            0: 1,
            5: 6,
        }
        rel friends = </World/Box>
    }
}
"""
WEAK = """#usda 1.0
(
    subLayers = [@./deep/below.usda@]
)

over "World"
{
    over "Ball" (
        prepend references = @./props/prop.usda@</Prop>
        customData = {
            int weak = 1
        }
    )
    {
        double size = 9
        double size.timeSamples = {
            0: 100,
        }
    }

    def Cone "Cone"
    {
    }
}
"""
BELOW = '#usda 1.0\n\ndef "World"\n{\n    def "Below"\n    {\n        asset a = @./x.png@\n    }\n}\n'
PROP = '#usda 1.0\n\ndef Sphere "Prop"\n{\n    double mass = 3\n}\n'


@pytest.fixture
def folder(tmp_path):
    for name, text in (("root", ROOT), ("strong", STRONG), ("weak", WEAK), ("deep/below", BELOW),
                       ("props/prop", PROP)):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / f"{name}.usda").write_text(text)
    return tmp_path


@pytest.fixture
def ctx(folder):
    context = omni_usd.create_context("test")
    assert context.open_stage(str(folder / "root.usda"))
    yield context
    assert omni_usd.destroy_context("test")


@pytest.fixture
def stage(ctx):
    return ctx.get_stage()


@pytest.fixture
def layer(folder):
    return lambda name: Sdf.Layer.FindOrOpen(str(folder / f"{name}.usda"))


def run(name, **arguments):
    ok, result = commands.execute(name, usd_context="test", **arguments)
    assert ok, name
    return result


def refused(caplog, name, said, **arguments):
    caplog.clear()
    assert commands.execute(name, usd_context="test", **arguments) == (False, None)
    assert said in caplog.text, caplog.text


def texts(stage):
    """The layers' content, without the delegate of auto authoring, which mirrors it."""
    return {layer.identifier: layer.ExportToString() for layer in stage.GetLayerStack()
            if "__DELTA_LAYER__" not in layer.identifier}


def composed(stage):
    """The composed content, without the layers that it comes from and their order."""
    values = {}
    for prim in stage.Traverse():
        values[str(prim.GetPath())] = prim.GetTypeName()
        for attribute in prim.GetAuthoredAttributes():
            value = [attribute.Get(), *(attribute.Get(t) for t in (-5, 0, 3, 10, 15, 20, 30))]
            values[str(attribute.GetPath())] = [
                os.path.realpath(v.resolvedPath or "") if isinstance(v, Sdf.AssetPath) else v for v in value]
        for relationship in prim.GetAuthoredRelationships():
            values[str(relationship.GetPath())] = relationship.GetTargets()
        values[str(prim.GetPath()) + " data"] = (
            prim.GetCustomData(), prim.GetMetadata("comment"), prim.GetVariantSets().GetNames())
    return values


class Undone:
    """Checks for everything that is executed within: undo restores every layer, and redo does it again."""

    def __init__(self, stage):
        self.stage = stage

    def __enter__(self):
        self.before, self.muted = texts(self.stage), set(self.stage.GetMutedLayers())
        self.target = self.stage.GetEditTarget().GetLayer().identifier

    def __exit__(self, kind, *_):
        if kind:
            return
        after = texts(self.stage)
        for _ in range(2):
            result = undo.undo("test")
            assert result and not result.kept, result
            assert texts(self.stage) == self.before
            assert set(self.stage.GetMutedLayers()) == self.muted
            assert self.stage.GetEditTarget().GetLayer().identifier == self.target
            assert undo.redo("test")
            assert texts(self.stage) == after
        assert undo.undo("test") and not undo.can_undo("test")


# -- commands and the stack


class SetComment(commands.RecordedCommand):
    def __init__(self, text, usd_context=""):
        super().__init__(usd_context)
        self.text = text

    def edit(self, recorder):
        recorder.touch(self.stage.GetRootLayer())
        self.stage.GetRootLayer().comment = self.text
        return self.text


class FailingCommand(commands.RecordedCommand):
    def __init__(self, usd_context=""):
        super().__init__(usd_context)

    def edit(self, recorder):
        recorder.touch(self.stage.GetRootLayer())
        self.stage.GetRootLayer().comment = "half done"
        commands.execute("SetComment", text="nested", usd_context="test")
        raise ValueError("on purpose")


@pytest.fixture
def registered():
    found = commands.register_all_commands_in_module(sys.modules[__name__])
    yield found
    commands.unregister_module_commands(found)


def test_a_module_is_registered_and_unregistered(registered, ctx, caplog):
    assert {c.__name__ for c in registered} == {"SetComment", "FailingCommand", "EditCommand", "WriteCommand"}
    assert commands.get_command_class("Failing") is FailingCommand
    assert commands.get_command_class("FailingCommand") is FailingCommand
    assert run("SetComment", text="a") == "a"
    commands.unregister(SetComment)
    refused(caplog, "SetComment", "no such command", text="b")
    with pytest.raises(TypeError):
        commands.register(types.SimpleNamespace)


def test_a_failed_command_leaves_nothing_and_reports_the_reason(registered, ctx, stage, caplog):
    refused(caplog, "Failing", "on purpose")
    assert stage.GetRootLayer().comment == "" and not undo.can_undo("test")
    refused(caplog, "SetComment", "required argument", txt="a")
    assert commands.execute("SetComment", text="a", usd_context="nobody") == (False, None)
    assert "nobody" in caplog.text
    assert ctx.close_stage()
    refused(caplog, "SetComment", "no stage is open", text="a")


def test_undo_redo_and_groups(registered, ctx, stage):
    root = stage.GetRootLayer()
    assert not undo.undo("test") and not undo.redo("test")
    with undo.group():
        run("SetComment", text="a")
        with undo.group():
            run("SetComment", text="b")
    run("SetComment", text="c")
    assert [entry.name for entry in undo.get_undo_stack("test")] == ["group", "SetComment"]
    assert undo.undo("test").name == "SetComment" and root.comment == "b"
    assert undo.undo("test") and root.comment == ""
    assert undo.redo("test") and root.comment == "b" and undo.can_redo("test")
    run("SetComment", text="d")
    assert not undo.can_redo("test"), "a new command clears the redo stack"
    assert undo.undo("test") and undo.undo("test") and root.comment == ""
    with undo.disabled():
        run("SetComment", text="e")
    assert not undo.can_undo("test") and root.comment == "e"


def test_an_end_without_a_beginning_does_nothing(registered, ctx, stage):
    undo.end_group()
    undo.end_disabled()
    with undo.group():
        run("SetComment", text="a")
        run("SetComment", text="b")
    run("SetComment", text="c")
    assert [entry.name for entry in undo.get_undo_stack("test")] == ["group", "SetComment"]
    with undo.disabled():
        run("SetComment", text="d")
    assert len(undo.get_undo_stack("test")) == 2


def test_a_command_of_ones_own_without_recorder(ctx):
    done = []

    class AppendCommand(commands.Command):
        def do(self):
            done.append(1)

        def undo(self):
            done.pop()

    class OnceCommand(commands.Command):
        def do(self):
            commands.execute("Append")
            return "once"

    for command in (AppendCommand, OnceCommand):
        commands.register(command)
    try:
        undo.clear_stack()
        assert commands.execute("Once") == (True, "once") and done == [1]
        assert undo.undo() and done == [] and undo.redo() and done == [1]
    finally:
        for command in (AppendCommand, OnceCommand):
            commands.unregister(command)
        undo.clear_stack()


def test_each_context_has_its_own_stack_which_ends_with_the_stage(registered, ctx, stage):
    other = omni_usd.create_context("other")
    try:
        assert other.new_stage()
        run("SetComment", text="here")
        assert commands.execute("SetComment", text="there", usd_context=other) == (True, "there")
        assert undo.undo(other) and other.get_stage().GetRootLayer().comment == ""
        assert stage.GetRootLayer().comment == "here" and undo.can_undo("test")
        ctx.close_stage()
        assert not undo.can_undo("test")
    finally:
        omni_usd.destroy_context("other")


def test_the_stack_is_bounded(registered, ctx):
    for index in range(250):
        run("SetComment", text=str(index))
    assert len(undo.get_undo_stack("test")) == 200


# -- the recorder


def scattered(seed):
    """A layer with some content of each kind."""
    dice = random.Random(seed)
    layer = Sdf.Layer.CreateAnonymous(".usda")
    stage = Usd.Stage.Open(layer)
    for _ in range(12):
        mutate(stage, dice)
    return stage, dice


def mutate(stage, dice):
    names = ["A", "B", "C"]
    path = "/" + "/".join(dice.choice(names) for _ in range(dice.randint(1, 3)))
    prim = stage.GetPrimAtPath(path) or stage.DefinePrim(path, dice.choice(["Xform", "Sphere", ""]))
    action = dice.randrange(10)
    if action == 0:
        stage.RemovePrim(path)
    elif action == 1:
        prim.CreateAttribute("a", Sdf.ValueTypeNames.Double).Set(dice.random(), dice.randint(0, 3))
    elif action == 2:
        prim.CreateAttribute("b", Sdf.ValueTypeNames.String).Set(str(dice.random()))
    elif action == 3:
        prim.SetCustomDataByKey(dice.choice(["x", "y:z", "y:w"]), dice.random())
    elif action == 4:
        prim.CreateRelationship("r").AddTarget(f"/{dice.choice(names)}")
    elif action == 5:
        prim.GetReferences().AddInternalReference(f"/{dice.choice(names)}X")
    elif action == 6:
        variants = prim.GetVariantSets().AddVariantSet("v")
        variants.AddVariant(dice.choice(names))
        variants.SetVariantSelection(dice.choice(names))
    elif action == 7:
        prim.CreateAttribute("c", Sdf.ValueTypeNames.Double).AddConnection(f"/{dice.choice(names)}.a")
    elif action == 8:
        stage.GetRootLayer().customLayerData = {"k": {dice.choice(names): dice.random()}}
    else:
        stage.GetRootLayer().subLayerPaths = [f"./{name}.usda" for name in dice.sample(names, 2)]


@pytest.mark.parametrize("seed", range(40))
def test_any_recorded_edit_is_undone(seed, capfd):
    """Undo restores the layer exactly; also if it is shared and nobody else wrote."""
    for shared in (False, True):
        stage, dice = scattered(seed)
        layer = stage.GetRootLayer()
        before = layer.ExportToString()
        recorder = Recorder()
        recorder.touch(layer, deep=True)
        for _ in range(10):
            mutate(stage, dice)
        record = recorder.finish()
        assert record.undo(lambda _: shared) == []
        assert layer.ExportToString() == before


@pytest.mark.parametrize("seed", range(20))
def test_a_layer_is_made_like_another(seed, capfd):
    stage, dice = scattered(seed)
    other, _ = scattered(seed + 1000)
    make_like(stage.GetRootLayer(), other.GetRootLayer())
    want, have = (Sdf.Layer.CreateAnonymous(".usda") for _ in range(2))
    want.TransferContent(other.GetRootLayer())
    have.TransferContent(stage.GetRootLayer())
    assert sorted(have.ExportToString().splitlines()) == sorted(want.ExportToString().splitlines())


def two_wrote(first, second):
    """The result when the second author has written after the first, and the first undoes."""
    layer = Sdf.Layer.CreateAnonymous(".usda")
    stage = Usd.Stage.Open(layer)
    prim = stage.DefinePrim("/A")
    prim.CreateAttribute("x", Sdf.ValueTypeNames.Double).Set(0.0)
    prim.SetCustomDataByKey("mine", 0)
    prim.GetReferences().AddInternalReference("/Old")
    layer.subLayerPaths = ["./old.usda"]
    recorder = Recorder()
    recorder.touch(layer, deep=True)
    first(stage, prim)
    record = recorder.finish()
    second(stage, stage.GetPrimAtPath("/A"))
    return stage, record.undo(lambda _: True)


def x(prim):
    return prim.GetAttribute("x")


def test_a_register_that_another_one_has_written_since_is_left():
    stage, kept = two_wrote(lambda s, p: (x(p).Set(1.0), x(p).Set(5.0, 1.0), x(p).Set(6.0, 2.0)),
                            lambda s, p: (x(p).Set(2.0), x(p).Set(7.0, 2.0)))
    value = stage.GetAttributeAtPath("/A.x")
    assert value.Get() == 2 and value.GetTimeSamples() == [2.0] and value.Get(2.0) == 7
    assert {(k.path, k.field, k.part) for k in kept} == {
        ("/A.x", "default", None), ("/A.x", "timeSamples", 2.0)}
    assert "another user" in str(kept[0]) and "/A.x" in str(kept[0])


def test_other_keys_and_items_of_one_field_are_left():
    def first(stage, prim):
        prim.SetCustomDataByKey("mine", 1)
        prim.SetCustomDataByKey("deep:mine", 1)
        prim.GetReferences().AddInternalReference("/Mine")
        prim.GetReferences().RemoveReference(Sdf.Reference(primPath="/Old"))
        stage.GetRootLayer().subLayerPaths = ["./mine.usda"]

    def second(stage, prim):
        prim.SetCustomDataByKey("theirs", 2)
        prim.SetCustomDataByKey("deep:theirs", 2)
        prim.GetReferences().AddInternalReference("/Theirs")
        stage.GetRootLayer().subLayerPaths.append("./theirs.usda")

    stage, kept = two_wrote(first, second)
    prim = stage.GetPrimAtPath("/A")
    assert kept == []
    assert prim.GetCustomData() == {"mine": 0, "theirs": 2, "deep": {"theirs": 2}}
    references = stage.GetRootLayer().GetPrimAtPath("/A").referenceList
    assert {str(r.primPath) for r in references.prependedItems} == {"/Old", "/Theirs"}
    assert list(references.deletedItems) == []
    assert list(stage.GetRootLayer().subLayerPaths) == ["./old.usda", "./theirs.usda"]


def test_nan_equals_itself():
    stage, kept = two_wrote(lambda s, p: x(p).Set(float("nan")), lambda s, p: None)
    assert kept == [] and stage.GetAttributeAtPath("/A.x").Get() == 0


def test_a_prim_that_another_one_has_filled_stays():
    stage, kept = two_wrote(lambda s, p: (s.DefinePrim("/New/In"), s.DefinePrim("/Mine")),
                            lambda s, p: s.DefinePrim("/New/Theirs"))
    assert stage.GetPrimAtPath("/New/Theirs") and not stage.GetPrimAtPath("/New/In")
    assert not stage.GetPrimAtPath("/Mine") and [k.path for k in kept] == ["/New"]


def test_a_prim_that_somebody_else_created_again_stays():
    stage, kept = two_wrote(lambda s, p: s.RemovePrim("/A"), lambda s, p: s.DefinePrim("/A", "Sphere"))
    assert stage.GetPrimAtPath("/A").GetTypeName() == "Sphere" and [k.path for k in kept] == ["/A"]


def test_a_spec_that_somebody_else_deleted_stays_deleted():
    stage, kept = two_wrote(lambda s, p: x(p).Set(1.0), lambda s, p: s.RemovePrim("/A"))
    assert not stage.GetPrimAtPath("/A") and kept and "no longer there" in kept[0].reason


# -- sublayers


def test_set_edit_target(ctx, stage, layer, caplog):
    with Undone(stage):
        run("SetEditTarget", layer_identifier=layer("weak").identifier)
        assert stage.GetEditTarget().GetLayer() == layer("weak")
    run("SetEditTarget", layer_identifier="none.usda")
    assert "is not a layer of this stage" in caplog.text
    assert stage.GetEditTarget().GetLayer() == layer("root")
    run("SetEditTarget", layer_identifier=layer("weak").identifier)
    stage.MuteLayer(layer("strong").identifier)
    run("SetEditTarget", layer_identifier=layer("root").identifier)
    stage.MuteLayer(layer("weak").identifier)
    undo.undo("test")
    assert stage.GetEditTarget().GetLayer() == layer("root"), "a muted layer became the edit target"


def test_create_a_sublayer(ctx, stage, layer, folder, caplog):
    root = layer("root")
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    stage.SetTimeCodesPerSecond(48)
    new = str(folder / "sub" / "new.usda")
    for path, position, expected in (("", 0, 0), (new, -1, 2), ("", 9, 2), ("", 1, 1)):
        with Undone(stage):
            identifier = run("CreateSublayer", layer_identifier=root.identifier, sublayer_position=position,
                             new_layer_path=path, transfer_root_content=False, create_or_insert=True,
                             layer_name="mine" if path else "")
            made = Sdf.Layer.Find(identifier)
            assert Sdf.Layer.FindRelativeToLayer(root, root.subLayerPaths[expected]) == made
            assert made.timeCodesPerSecond == 48 and made.pseudoRoot.GetInfo("upAxis") == "Z"
            assert made.anonymous == (not path) and not made.subLayerPaths
            if path:
                assert root.subLayerPaths[2] == "./sub/new.usda"
                assert made.customLayerData == {"omni_layer": {"custom_name": "mine"}}
            del made
    arguments = dict(transfer_root_content=False, create_or_insert=False)
    for position, path, said in ((-2, str(folder / "props/prop.usda"), "position"),
                                 (0, layer("weak").identifier, "already"), (0, root.identifier, "sublayer"),
                                 (0, str(folder / "none.usda"), "none.usda")):
        refused(caplog, "CreateSublayer", said, layer_identifier=root.identifier, sublayer_position=position,
                new_layer_path=path, **arguments)
    refused(caplog, "CreateSublayer", "has", layer_identifier=layer("deep/below").identifier,
            sublayer_position=0, new_layer_path=layer("weak").identifier, **arguments)
    refused(caplog, "CreateSublayer", "is not a layer of this stage",
            layer_identifier=layer("props/prop").identifier, sublayer_position=0, new_layer_path="",
            transfer_root_content=False, create_or_insert=True)
    with Undone(stage):
        inserted = run("CreateSublayer", layer_identifier=root.identifier, sublayer_position=0,
                       new_layer_path=str(folder / "props/prop.usda"), **arguments)
        assert inserted == layer("props/prop").identifier


def test_an_existing_sublayer_is_emptied_and_restored(ctx, stage, layer, folder):
    prop = layer("props/prop")
    with Undone(stage):
        run("CreateSublayer", layer_identifier=layer("root").identifier, sublayer_position=0,
            new_layer_path=prop.identifier, transfer_root_content=False, create_or_insert=True)
        assert not prop.rootPrims
    assert "double mass = 3" in prop.ExportToString()


def test_root_content_is_moved_into_a_new_sublayer(ctx, stage, layer, folder):
    before = composed(stage)
    with Undone(stage):
        identifier = run("CreateSublayer", layer_identifier=layer("root").identifier, sublayer_position=0,
                         new_layer_path=str(folder / "sub" / "new.usda"), transfer_root_content=True,
                         create_or_insert=True)
        text = Sdf.Layer.Find(identifier).ExportToString()
        assert "@../textures/ball.png@" in text and "@Library.mdl@" in text
        assert not layer("root").rootPrims and composed(stage) == before
    assert os.path.exists(folder / "sub" / "new.usda"), "the file stays"


def test_remove_a_sublayer(ctx, stage, layer, caplog):
    root, strong = layer("root"), layer("strong")
    root.customLayerData = {"omni_layer": {"muteness": {"./strong.usda": False, "./weak.usda": True},
                                           "locked": {"./strong.usda": True}}}
    # Kit's map locks the layer itself, not the list that contains it.
    stage.SetEditTarget(strong)
    with Undone(stage):
        run("RemoveSublayer", layer_identifier=root.identifier, sublayer_position=0)
        assert list(root.subLayerPaths) == ["./weak.usda"]
        assert root.customLayerData["omni_layer"] == {"muteness": {"./weak.usda": True}}
        assert stage.GetEditTarget().GetLayer() == root
    assert root.subLayerOffsets[0] == Sdf.LayerOffset(10, 2)
    for position in (2, -1):
        refused(caplog, "RemoveSublayer", "no sublayer", layer_identifier=root.identifier,
                sublayer_position=position)


def test_removing_a_muted_sublayer_or_one_in_memory_can_be_undone(ctx, stage, layer):
    root = layer("root")
    stage.MuteLayer(layer("strong").identifier)
    with Undone(stage):
        run("RemoveSublayer", layer_identifier=root.identifier, sublayer_position=0)
        assert layer("strong").identifier not in stage.GetMutedLayers()
    stage.UnmuteLayer(layer("strong").identifier)
    memory = Sdf.Layer.CreateAnonymous()
    memory.comment = "only here"
    root.subLayerPaths.insert(0, memory.identifier)
    identifier = memory.identifier
    del memory
    with Undone(stage):
        run("RemoveSublayer", layer_identifier=root.identifier, sublayer_position=0)
    assert Sdf.Layer.Find(identifier).comment == "only here"


def test_replace_a_sublayer(ctx, stage, layer, caplog):
    root = layer("root")
    stage.SetEditTarget(stage.GetEditTargetForLocalLayer(layer("strong")))
    with Undone(stage):
        run("ReplaceSublayer", layer_identifier=root.identifier, sublayer_position=0,
            new_layer_path=layer("props/prop").identifier)
        assert list(root.subLayerPaths) == ["./props/prop.usda", "./weak.usda"]
        assert root.subLayerOffsets[0] == Sdf.LayerOffset(10, 2)
        assert stage.GetEditTarget().GetLayer() == layer("props/prop")
    before = texts(stage)
    refused(caplog, "ReplaceSublayer", "already", layer_identifier=root.identifier, sublayer_position=0,
            new_layer_path=layer("weak").identifier)
    assert texts(stage) == before


def test_move_a_sublayer(ctx, stage, layer, caplog):
    root, weak = layer("root"), layer("weak")
    for position in (1, -1, 7):
        with Undone(stage):
            run("MoveSublayer", from_parent_layer_identifier=root.identifier, from_sublayer_position=0,
                to_parent_layer_identifier=root.identifier, to_sublayer_position=position)
            assert list(root.subLayerPaths) == ["./weak.usda", "./strong.usda"]
            assert root.subLayerOffsets[1] == Sdf.LayerOffset(10, 2)
    for remove in (True, False):
        with Undone(stage):
            run("MoveSublayer", from_parent_layer_identifier=weak.identifier, from_sublayer_position=0,
                to_parent_layer_identifier=root.identifier, to_sublayer_position=0, remove_source=remove)
            assert list(root.subLayerPaths)[0] == "./deep/below.usda"
            assert len(weak.subLayerPaths) == (0 if remove else 1)
    refused(caplog, "MoveSublayer", "has", from_parent_layer_identifier=root.identifier,
            from_sublayer_position=1, to_parent_layer_identifier=layer("deep/below").identifier,
            to_sublayer_position=0, remove_source=True)


# -- content


@pytest.mark.parametrize("stronger", [True, False])
def test_merged_layers_compose_the_same(stronger, ctx, stage, layer, folder):
    root = layer("root")
    if not stronger:  # the source is the upper one
        root.subLayerPaths = ["./weak.usda", "./strong.usda"]
        root.subLayerOffsets[1] = Sdf.LayerOffset(10, 2)
    before = composed(stage)
    dst, src = layer("strong"), layer("weak")
    with Undone(stage):
        run("MergeLayers", dst_parent_layer_identifier=root.identifier, dst_layer_identifier=dst.identifier,
            src_parent_layer_identifier=root.identifier, src_layer_identifier=src.identifier,
            dst_stronger_than_src=stronger)
        assert list(root.subLayerPaths) == ["./strong.usda"]
        assert list(dst.subLayerPaths) == ["./deep/below.usda"]
        assert "references = @./props/prop.usda@" in dst.ExportToString()
        assert composed(stage) == before


def test_a_sublayer_is_merged_into_its_parent(ctx, stage, layer):
    before, root = composed(stage), layer("root")
    with Undone(stage):
        run("MergeLayers", dst_parent_layer_identifier="", dst_layer_identifier=root.identifier,
            src_parent_layer_identifier=root.identifier, src_layer_identifier=layer("strong").identifier,
            dst_stronger_than_src=True)
        assert composed(stage) == before and list(root.subLayerPaths) == ["./weak.usda"]


def test_merging_with_muted_or_missing_layers(ctx, stage, layer, caplog):
    root, strong, weak = layer("root"), layer("strong"), layer("weak")
    arguments = dict(dst_parent_layer_identifier=root.identifier, dst_layer_identifier=strong.identifier,
                     src_parent_layer_identifier=root.identifier, src_layer_identifier=weak.identifier,
                     dst_stronger_than_src=True)
    for muted, left in ((strong, "./weak.usda"), (weak, "./strong.usda")):
        stage.MuteLayer(muted.identifier)
        with Undone(stage):
            run("MergeLayers", **arguments)
            assert list(root.subLayerPaths) == [left]
        stage.UnmuteLayer(muted.identifier)
    refused(caplog, "MergeLayers", "itself", **{**arguments, "src_layer_identifier": strong.identifier})
    refused(caplog, "MergeLayers", "not a sublayer", **{
        **arguments, "src_parent_layer_identifier": weak.identifier,
        "src_layer_identifier": strong.identifier, "dst_layer_identifier": weak.identifier})


def test_flattened_layers_compose_the_same(ctx, stage, layer):
    before, root = composed(stage), layer("root")
    session = stage.GetSessionLayer()
    with Usd.EditContext(stage, session):
        stage.GetAttributeAtPath("/World/Ball.radius").Set(77.0)
    before = composed(stage)
    with Undone(stage):
        run("FlattenLayers")
        assert list(root.subLayerPaths) == [] and composed(stage) == before
        assert "77" not in root.ExportToString() and "@./deep/x.png@" in root.ExportToString()


@pytest.mark.parametrize("command", ["merge", "flatten"])
def test_prims_keep_their_order(command, ctx, stage, layer):
    strong, weak = layer("strong"), layer("weak")
    for name in ("Z", "M", "A"):
        Sdf.CreatePrimInLayer(strong, f"/{name}").specifier = Sdf.SpecifierDef
    for name in ("Q", "M", "B", "World"):
        for child in ("y", "x"):
            Sdf.CreatePrimInLayer(weak, f"/{name}/{child}{name}").specifier = Sdf.SpecifierDef

    def order():
        return [str(prim.GetPath()) for prim in Usd.PrimRange.Stage(stage, Usd.PrimAllPrimsPredicate)]

    before = order()
    with Undone(stage):
        if command == "flatten":
            run("FlattenLayers")
        else:
            run("MergeLayers", dst_parent_layer_identifier=layer("root").identifier,
                dst_layer_identifier=strong.identifier, src_parent_layer_identifier=layer("root").identifier,
                src_layer_identifier=weak.identifier, dst_stronger_than_src=True)
        assert order() == before
    assert order() == before


@pytest.mark.parametrize("seed", range(15))
def test_random_layers_compose_the_same_when_they_are_merged(seed, ctx, capfd):
    stages = [scattered(seed * 10 + index)[0] for index in range(4)]
    held = [stage.GetRootLayer() for stage in stages]
    layers = [sublayer.identifier for sublayer in held]
    for sublayer in held:
        sublayer.subLayerPaths = []
    root = Sdf.Layer.CreateAnonymous(".usda")
    root.subLayerPaths = layers
    root.subLayerOffsets[1] = Sdf.LayerOffset(5, 2)
    root.subLayerOffsets[2] = Sdf.LayerOffset(-1)
    held[2].timeCodesPerSecond = 48
    stage = Usd.Stage.Open(root)
    assert ctx.attach_stage(stage)
    before = composed(stage)
    with Undone(stage):
        run("MergeLayers", dst_parent_layer_identifier=root.identifier, dst_layer_identifier=layers[1],
            src_parent_layer_identifier=root.identifier, src_layer_identifier=layers[2],
            dst_stronger_than_src=True)
        assert composed(stage) == before
    with Undone(stage):
        run("MergeLayers", dst_parent_layer_identifier=root.identifier, dst_layer_identifier=layers[2],
            src_parent_layer_identifier=root.identifier, src_layer_identifier=layers[1],
            dst_stronger_than_src=False)
        assert composed(stage) == before
    with Undone(stage):
        run("FlattenLayers")
        assert composed(stage) == before


def test_cyclic_sublayers_are_flattened(ctx, stage, layer):
    layer("deep/below").subLayerPaths.append("../weak.usda")
    before = composed(stage)
    with Undone(stage):
        run("FlattenLayers")
        assert composed(stage) == before and not layer("root").subLayerPaths


def test_create_a_reference_in_one_layer(ctx, stage, layer, caplog):
    weak, prop = layer("weak"), layer("props/prop")
    with Undone(stage):
        path = run("CreateLayerReference", layer_identifier=weak.identifier, path_to="/World/Cone",
                   asset_path=prop.identifier, prim_path="/Prop")
        assert path == "/World/Cone_01" and stage.GetAttributeAtPath("/World/Cone_01.mass").Get() == 3
        assert "@./props/prop.usda@</Prop>" in weak.ExportToString()
        assert not layer("root").GetPrimAtPath(path)
    refused(caplog, "CreateLayerReference", "not the path", layer_identifier=weak.identifier, path_to="/World.x")


def test_remove_prim_specs(ctx, stage, layer, caplog):
    root = layer("root")
    for paths in ("/World/Ball", ["/World/Ball", "/World/Box"], ["/World", "/World/Ball"]):
        with Undone(stage):
            run("RemovePrimSpec", layer_identifier=root.identifier, prim_spec_path=paths)
            assert not root.GetPrimAtPath("/World/Ball") and layer("strong").GetPrimAtPath("/World/Ball")
    for path, said in (("/World/None", "no prim"), ("no path", "not the path"), ("/World.x", "not the path")):
        refused(caplog, "RemovePrimSpec", said, layer_identifier=root.identifier,
                prim_spec_path=["/World/Ball", path])
    assert root.GetPrimAtPath("/World/Ball")
    layer("weak").SetPermissionToEdit(False)
    refused(caplog, "RemovePrimSpec", "does not permit edits", layer_identifier=layer("weak").identifier,
            prim_spec_path="/World/Ball")
    layer("weak").SetPermissionToEdit(True)
    layer("weak").customLayerData = {"omni_layer": {"locked": True}}
    refused(caplog, "RemovePrimSpec", "is locked", layer_identifier=layer("weak").identifier,
            prim_spec_path="/World/Ball")


@pytest.mark.parametrize("target", ["root", "strong", "deep/below"])
def test_prims_are_stitched_to_one_layer(target, ctx, stage, layer):
    before = composed(stage)
    with Undone(stage):
        run("StitchPrimSpecsToLayer", prim_paths=["/World/Ball"],
            target_layer_identifier=layer(target).identifier)
        assert composed(stage) == before
        for name in ("root", "strong", "weak", "deep/below"):
            assert bool(layer(name).GetPrimAtPath("/World/Ball")) == (name == target)


@pytest.mark.parametrize("stronger", [True, False])
def test_prims_are_moved_to_another_layer(stronger, ctx, stage, layer, caplog):
    strong, below = layer("strong"), layer("deep/below")
    source, target = (below, strong) if stronger else (strong, below)
    before = composed(stage)
    with Undone(stage):
        run("MovePrimSpecsToLayer", dst_layer_identifier=target.identifier,
            src_layer_identifier=source.identifier, prim_spec_path="/World", dst_stronger_than_src=stronger)
        assert not source.GetPrimAtPath("/World") and target.GetPrimAtPath("/World")
        if stronger:
            assert composed(stage) == before and "@./deep/x.png@" in target.ExportToString()
    refused(caplog, "MovePrimSpecsToLayer", "no prim", dst_layer_identifier=target.identifier,
            src_layer_identifier=source.identifier, prim_spec_path="/None", dst_stronger_than_src=True)


def move(**arguments):
    ok, _ = commands.execute("MovePrim", stage_or_context="test", **arguments)
    return ok


def test_move_a_prim(ctx, stage, layer, caplog):
    UsdGeom.Xformable(stage.GetPrimAtPath("/World")).AddTranslateOp().Set((1, 2, 3))
    world = UsdGeom.XformCache().GetLocalToWorldTransform(stage.GetPrimAtPath("/World/Ball"))
    moved = []
    with Undone(stage):
        assert move(path_from="/World/Ball", path_to="/Ball", on_move_fn=lambda *p: moved.append(p))
        assert not stage.GetPrimAtPath("/World/Ball")
        assert stage.GetPrimAtPath("/Ball").GetTypeName() == "Sphere"
        assert all(layer(name).GetPrimAtPath("/Ball") for name in ("root", "strong", "weak"))
        assert UsdGeom.XformCache().GetLocalToWorldTransform(stage.GetPrimAtPath("/Ball")) == world
    assert moved[:2] == [("/World/Ball", "/Ball"), ("/Ball", "/World/Ball")]
    for source, target in (("/World/None", "/A"), ("/World/Ball", "/World/Box"),
                           ("/World", "/World/Ball/In")):
        assert not move(path_from=source, path_to=target) and source in caplog.text


def test_a_prim_of_a_locked_layer_is_not_moved(ctx, stage, layer, caplog):
    layer("weak").customLayerData = {"omni_layer": {"locked": True}}
    before = texts(stage)
    assert not move(path_from="/World/Ball", path_to="/World/Moved")
    assert "weak.usda is locked" in caplog.text and texts(stage) == before


@pytest.mark.parametrize("lock", ["Kit's", "permission"])
def test_a_prim_to_which_a_locked_layer_points_is_not_moved(ctx, stage, layer, caplog, lock):
    weak = layer("weak")
    stage.SetEditTarget(stage.GetEditTargetForLocalLayer(weak))
    stage.DefinePrim("/Pointing").CreateRelationship("to").AddTarget("/Alone")
    stage.SetEditTarget(stage.GetEditTargetForLocalLayer(layer("root")))
    stage.DefinePrim("/Alone")
    if lock == "Kit's":
        weak.customLayerData = {"omni_layer": {"locked": True}}
    else:
        weak.SetPermissionToEdit(False)
    before = texts(stage)
    assert not move(path_from="/Alone", path_to="/Moved")
    assert "weak.usda" in caplog.text and texts(stage) == before
    weak.SetPermissionToEdit(True)


def test_a_prim_with_a_relocate_below_it_is_moved(ctx, stage, layer, folder):
    (folder / "asset.usda").write_text(
        '#usda 1.0\ndef "R"\n{\n    def "P"\n    {\n        def "D"\n        {\n        }\n    }\n}\n')
    stage.DefinePrim("/A").GetReferences().AddReference("./asset.usda", "/R")
    layer("root").relocates = [("/A/P/D", "/A/P/L")]
    assert stage.GetPrimAtPath("/A/P/L")
    with Undone(stage):
        assert move(path_from="/A/P", path_to="/A/Q")
        assert stage.GetPrimAtPath("/A/Q/L") and not stage.GetPrimAtPath("/A/P")


def test_move_a_prim_without_touching_weaker_layers(ctx, stage, layer):
    stage.SetEditTarget(stage.GetEditTargetForLocalLayer(layer("strong")))
    others = {name: layer(name).ExportToString() for name in ("root", "weak")}
    with Undone(stage):
        assert move(path_from="/World/Ball", path_to="/World/Moved", destructive=False)
        assert not stage.GetPrimAtPath("/World/Ball").IsActive()
        assert stage.GetAttributeAtPath("/World/Moved.radius").Get() == 1
        assert stage.GetAttributeAtPath("/World/Moved.size").Get(20.0) == 6
        assert stage.GetAttributeAtPath("/World/Moved.mass").Get() == 3
        assert {name: layer(name).ExportToString() for name in others} == others


def test_reorder_a_prim(ctx, stage, layer):
    stage.SetEditTarget(stage.GetEditTargetForLocalLayer(layer("weak")))

    def names(path="/World"):
        return stage.GetPrimAtPath(path).GetAllChildrenNames()

    before = names()
    with Undone(stage):
        assert commands.execute("ReorderPrim", prim_path=f"/World/{before[-1]}", position=0,
                                stage_or_context="test")[0]
        assert names() == [before[-1], *before[:-1]]
        assert layer("root").GetPrimAtPath("/World").nameChildrenOrder
    stage.DefinePrim("/Other")
    with Undone(stage):
        assert commands.execute("ReorderPrim", prim_path="/World", position=-1, stage_or_context="test")[0]
        assert names("/") == ["Other", "World"]


# -- helpers of omni.usd


def test_layer_helpers(layer, folder):
    root, below = layer("root"), layer("deep/below")
    copy = Sdf.Layer.CreateNew(str(folder / "deep" / "copy.usda"))
    copy.TransferContent(root)
    assert omni_usd.resolve_paths(root.identifier, copy.identifier)
    assert "@../textures/ball.png@" in copy.ExportToString() and "@Library.mdl@" in copy.ExportToString()
    assert list(copy.subLayerPaths) == ["../strong.usda", "../weak.usda"]
    assert copy.subLayerOffsets[0] == Sdf.LayerOffset(10, 2)
    assert omni_usd.resolve_paths(root.identifier, copy.identifier, relative_to_base_layer=True)
    assert copy.ExportToString() == root.ExportToString()
    assert omni_usd.merge_prim_spec(below.identifier, root.identifier, "/World/Ball", True, "/Other/Ball")
    assert "@../textures/ball.png@" in below.ExportToString() and below.GetPrimAtPath("/World/Below")
    assert not omni_usd.merge_prim_spec(below.identifier, root.identifier, "/None")
    assert omni_usd.merge_layers(below.identifier, root.identifier)
    assert below.GetPrimAtPath("/World/Box") and not below.subLayerPaths
    assert not omni_usd.merge_layers(below.identifier, "none") and not omni_usd.merge_layers(below, below)
    strong = layer("strong")
    omni_usd.resolve_prim_path_references(strong, "/World/Box", "/World/Crate")
    assert "rel friends = </World/Crate>" in strong.ExportToString()


# -- commands that use the parts of Layers by their documented names


class LayersParts:
    """The parts of a context's Layers that the commands change."""

    def __init__(self, layers):
        self.state, self.linking = layers.get_layers_state(), layers.get_specs_linking()
        self.locking = layers.get_specs_locking()
        self.link_spec, self.lock_spec = self.linking.link_spec, self.locking.lock_spec

    is_global = property(None, lambda self, value: self.state.set_muteness_scope(value))

    @property
    def locked(self):
        return {name for name in self.state.get_local_layer_identifiers() if self.state.is_layer_locked(name)}

    @property
    def links(self):
        links = self.linking.get_all_spec_links()
        return {(spec, layer) for spec, layers in links.items() for layer in layers}

    @property
    def specs(self):
        return set(self.locking.get_all_locked_specs())


@pytest.fixture
def layers(ctx):
    return LayersParts(get_layers(ctx))


def test_mute_a_layer(ctx, stage, layer, layers, caplog):
    strong = layer("strong")
    stage.SetEditTarget(stage.GetEditTargetForLocalLayer(strong))
    with Undone(stage):
        run("SetLayerMuteness", layer_identifier=strong.identifier, muted=True)
        assert stage.IsLayerMuted(strong.identifier) and stage.GetEditTarget().GetLayer() == layer("root")
        assert not layer("root").customLayerData
    layers.is_global = True
    with Undone(stage):
        run("SetLayerMuteness", layer_identifier=strong.identifier, muted=True)
        (path, muted), = layer("root").customLayerData["omni_layer"]["muteness"].items()
        assert "strong.usda" in path and muted is True
    for never in (layer("root"), stage.GetSessionLayer()):
        refused(caplog, "SetLayerMuteness", "cannot be muted", layer_identifier=never.identifier, muted=True)


def test_lock_a_layer(ctx, stage, layer, layers, caplog):
    strong = layer("strong")
    stage.SetEditTarget(stage.GetEditTargetForLocalLayer(strong))
    run("LockLayer", layer_identifier=strong.identifier, locked=True)
    assert layers.locked == {strong.identifier} and stage.GetEditTarget().GetLayer() == layer("root")
    assert undo.undo("test") and not layers.locked and stage.GetEditTarget().GetLayer() == strong
    refused(caplog, "LockLayer", "cannot be locked", layer_identifier=layer("root").identifier, locked=True)
    refused(caplog, "LockLayer", "is not a layer of this stage", layer_identifier=layer("props/prop").identifier,
            locked=True)


def test_a_muted_layer_is_locked_and_a_locked_one_is_no_edit_target(ctx, stage, layer, layers, caplog):
    strong = layer("strong")
    stage.MuteLayer(strong.identifier)
    run("LockLayer", layer_identifier=strong.identifier, locked=True)
    assert strong.identifier in layers.locked
    stage.UnmuteLayer(strong.identifier)
    strong.customLayerData = {"omni_layer": {"locked": True}}
    before = stage.GetEditTarget().GetLayer()
    assert not commands.execute("SetEditTarget", layer_identifier=strong.identifier, usd_context="test")[0]
    assert "is locked" in caplog.text and stage.GetEditTarget().GetLayer() == before
    assert not LayerUtils.set_edit_target(stage, strong.identifier)


def test_link_and_unlink_specs(ctx, layer, layers):
    root, strong, weak, below = (layer(name).identifier for name in ("root", "strong", "weak", "deep/below"))
    layers.link_spec("/World/Ball.radius", root)
    first = set(layers.links)
    changed = run("LinkSpecs", spec_paths="/World/Ball", layer_identifiers=[strong, weak])
    assert {"/World/Ball", "/World/Ball.radius"} <= set(changed)
    assert {("/World/Ball.radius", root), ("/World/Ball", weak)} <= layers.links
    second = set(layers.links)
    run("LinkSpecs", spec_paths=["/World"], layer_identifiers=below, additive=False, hierarchy=True)
    assert {layer for _, layer in layers.links} == {below}
    third = set(layers.links)
    run("UnlinkSpecs", spec_paths=["/World/Ball"], layer_identifiers=[below])
    for links in (third, second, first):
        assert undo.undo("test") and layers.links == links


def test_lock_and_unlock_specs(ctx, layers):
    layers.lock_spec("/World/Box")
    first = set(layers.specs)
    run("LockSpecs", spec_paths=["/World"], hierarchy=True)
    second = set(layers.specs)
    assert "/World/Ball.radius" in second
    run("UnlockSpecs", spec_paths="/World/Ball")
    assert "/World/Ball" not in layers.specs
    for specs in (second, first):
        assert undo.undo("test") and layers.specs == specs


# -- live


@pytest.fixture
def live(project, serve, editor, folder):
    for path in folder.rglob("*.usda"):
        if project not in path.parents:
            (project / path.relative_to(folder)).parent.mkdir(exist_ok=True)
            (project / path.relative_to(folder)).write_text(path.read_text())
    server = serve(project)
    context = omni_usd.create_context("test")
    assert context.open_stage(f"usdlive://127.0.0.1:{server.port}/root.usda")
    yield context, editor(server, "ada", "root.usda")
    omni_usd.destroy_context("test")


def synced(context, ada):
    """Waits until both have everything; returns the texts of the layers, which are the same for both."""
    names = ("root.usda", "strong.usda", "weak.usda", "deep/below.usda")
    connection = context.live
    assert connection.flush()
    ada.catch_up(connection.revision)
    revision = ada.flush()
    wait_frames(lambda: connection.revision >= revision)
    own = {name: connection.open_layer(name).ExportToString() for name in names}
    assert own == {name: ada.text(name) for name in names}
    return own


def test_commands_on_a_live_stage_are_one_transaction_each_and_undone_everywhere(live):
    context, ada = live
    stage, connection = context.get_stage(), context.live
    identifiers = {layer.GetDisplayName(): layer.identifier for layer in stage.GetLayerStack(False)}
    root = identifiers["root.usda"]
    before = synced(context, ada)
    for name, arguments in (
            ("MergeLayers", dict(dst_parent_layer_identifier=root,
                                 dst_layer_identifier=identifiers["strong.usda"],
                                 src_parent_layer_identifier=root,
                                 src_layer_identifier=identifiers["weak.usda"], dst_stronger_than_src=True)),
            ("StitchPrimSpecsToLayer", dict(prim_paths=["/World/Ball"],
                                            target_layer_identifier=identifiers["weak.usda"])),
            ("MoveSublayer", dict(from_parent_layer_identifier=root, from_sublayer_position=0,
                                  to_parent_layer_identifier=root, to_sublayer_position=1)),
            ("FlattenLayers", {})):
        values, revision = composed(stage), connection.revision
        run(name, **arguments)
        after = synced(context, ada)
        assert connection.revision == revision + 1, f"{name} is one transaction"
        assert after != before
        if name != "MoveSublayer":
            assert composed(stage) == values
        result = undo.undo("test")
        assert result and not result.kept, result
        assert synced(context, ada) == before and connection.revision == revision + 2
        assert undo.redo("test") and synced(context, ada) == after
        assert undo.undo("test") and synced(context, ada) == before


def test_undo_in_a_live_project_keeps_edits_of_others(live, caplog):
    context, ada = live
    stage = context.get_stage()
    root = stage.GetRootLayer().identifier
    strong = next(l.identifier for l in stage.GetLayerStack(False) if l.GetDisplayName() == "strong.usda")
    run("RemovePrimSpec", layer_identifier=strong, prim_spec_path="/World/Ball")
    with undo.group():
        run("CreateLayerReference", layer_identifier=root, path_to="/World/New",
            asset_path="./props/prop.usda", prim_path="/Prop")
        run("CreateLayerReference", layer_identifier=root, path_to="/World/Mine")
    synced(context, ada)
    ada.run("stage.GetPrimAtPath('/World/New').CreateAttribute('hers', Sdf.ValueTypeNames.Int).Set(1)\n"
            "over = Sdf.CreatePrimInLayer(layer('strong.usda'), '/World/Ball')\n"
            "Sdf.AttributeSpec(over, 'radius', Sdf.ValueTypeNames.Double).default = 50.0")
    synced(context, ada)
    with caplog.at_level(logging.WARNING):
        result = undo.undo("test")
    assert result and [kept.path for kept in result.kept] == ["/World/New"]
    assert "another user" in caplog.text and "/World/New" in caplog.text
    assert stage.GetAttributeAtPath("/World/New.hers").Get() == 1 and not stage.GetPrimAtPath("/World/Mine")
    result = undo.undo("test")
    assert result and [kept.path for kept in result.kept] == ["/World/Ball"]
    texts_now = synced(context, ada)
    assert "radius = 50" in texts_now["strong.usda"] and "int hers = 1" in texts_now["root.usda"]


class WriteCommand(commands.RecordedCommand):
    """Writes what `write(root layer)` writes."""

    def __init__(self, write, usd_context=""):
        super().__init__(usd_context)
        self._write = write

    def edit(self, recorder):
        for layer in self.stage.GetLayerStack(False):
            recorder.touch(layer, deep=True)
        self._write(self.stage.GetRootLayer())


@pytest.fixture
def writes():
    commands.register(WriteCommand)
    yield
    commands.unregister(WriteCommand)


def number(layer, path, value):
    """Gives the attribute a default value; None removes the attribute. Creates what it needs."""
    prim = Sdf.CreatePrimInLayer(layer, Sdf.Path(path).GetPrimPath())
    name = Sdf.Path(path).name
    if value is None:
        if name in prim.attributes:
            del prim.properties[name]
    else:
        attribute = prim.attributes.get(name) or Sdf.AttributeSpec(prim, name, Sdf.ValueTypeNames.Double)
        attribute.default = value


NUMBER = inspect.getsource(number) + """
number_of = number

def number(path, value, layer=stage.GetRootLayer()):
    number_of(layer, path, value)
"""


def write(context, ada, edit):
    assert commands.execute("Write", write=edit, usd_context="test")[0]
    synced(context, ada)


def colleague(context, ada, *codes):
    """Each code is a transaction of its own; the context receives all in one frame."""
    connection = context.live
    ada.run(NUMBER)
    for code in codes:
        ada.run(NUMBER + code)
        ada.flush()
    synced(context, ada)


def changed_back(result, kept):
    assert result and [(one.path, one.field) for one in result.kept] == kept, result


def test_a_value_that_another_one_has_written_again_stays(live, writes):
    context, ada = live
    ball = context.get_stage().GetRootLayer().GetAttributeAtPath("/World/Ball.radius")
    write(context, ada, lambda layer: number(layer, "/World/Ball.radius", 2.0))
    colleague(context, ada, "number('/World/Ball.radius', 3.0)", "number('/World/Ball.radius', 2.0)")
    changed_back(undo.undo("test"), [("/World/Ball.radius", "default")])
    synced(context, ada)
    assert ball.default == 2

    # Own writes since do not make it one's own.
    write(context, ada, lambda layer: number(layer, "/World/Ball.radius", 5.0))
    changed_back(undo.undo("test"), [])
    assert ball.default == 2


def test_a_value_that_another_one_has_written_before_is_restored(live, writes):
    context, ada = live
    ball = context.get_stage().GetRootLayer().GetAttributeAtPath("/World/Ball.radius")
    write(context, ada, lambda layer: number(layer, "/World/Ball.x", 1.0))
    colleague(context, ada, "number('/World/Ball.radius', 3.0)")
    # The undo comes before the server has confirmed the edit, too.
    assert commands.execute("Write", write=lambda layer: number(layer, "/World/Ball.radius", 4.0),
                            usd_context="test")[0]
    changed_back(undo.undo("test"), [])
    assert ball.default == 3
    changed_back(undo.redo("test"), [])
    synced(context, ada)
    changed_back(undo.undo("test"), [])
    assert ball.default == 3


def test_a_part_that_another_one_has_created_again_stays(live, writes):
    context, ada = live
    root = context.get_stage().GetRootLayer()
    write(context, ada, lambda layer: number(layer, "/World/Box.size", 2.0))
    colleague(context, ada, "number('/World/Box.size', None)", "number('/World/Box.size', 2.0)")
    changed_back(undo.undo("test"), [("/World/Box.size", None)])
    assert "size = 2" in synced(context, ada)["root.usda"] and root.GetAttributeAtPath("/World/Box.size")


def test_a_part_that_another_one_has_deleted_since_stays_deleted(live, writes):
    context, ada = live
    root = context.get_stage().GetRootLayer()
    write(context, ada, lambda layer: number(layer, "/World/Ball.radius", None))
    colleague(context, ada, "number('/World/Ball.radius', 7.0)", "number('/World/Ball.radius', None)")
    changed_back(undo.undo("test"), [("/World/Ball.radius", None)])
    synced(context, ada)
    assert not root.GetAttributeAtPath("/World/Ball.radius")


def test_redo_leaves_what_another_one_has_written_since(live, writes):
    context, ada = live
    root = context.get_stage().GetRootLayer()

    def both(layer):
        number(layer, "/World/Ball.radius", 2.0)
        number(layer, "/World/Ball.mine", 2.0)

    write(context, ada, both)
    changed_back(undo.undo("test"), [])
    synced(context, ada)
    colleague(context, ada, "number('/World/Ball.radius', 3.0)")
    for _ in range(2):
        changed_back(undo.redo("test"), [("/World/Ball.radius", "default")])
        synced(context, ada)
        assert root.GetAttributeAtPath("/World/Ball.radius").default == 3
        assert root.GetAttributeAtPath("/World/Ball.mine").default == 2
        changed_back(undo.undo("test"), [])
        synced(context, ada)
        assert root.GetAttributeAtPath("/World/Ball.radius").default == 3
        assert not root.GetAttributeAtPath("/World/Ball.mine")


def test_redo_does_not_delete_what_another_one_has_written_since(live, writes):
    context, ada = live
    root = context.get_stage().GetRootLayer()

    def delete(layer):
        world = layer.GetPrimAtPath("/World")
        if "Ball" in world.nameChildren:
            del world.nameChildren["Ball"]

    write(context, ada, delete)
    changed_back(undo.undo("test"), [])
    synced(context, ada)
    colleague(context, ada, "number('/World/Ball.radius', 3.0)")
    changed_back(undo.redo("test"), [("/World/Ball", None)])
    synced(context, ada)
    assert root.GetAttributeAtPath("/World/Ball.radius").default == 3


@pytest.mark.parametrize("seed", range(60))
def test_undo_and_redo_change_only_what_one_has_written_last(seed, live, writes):
    """The oracle knows for each attribute of each layer its value, and in which order both have written it."""
    context, ada = live
    get_layers(context).set_edit_mode(list(LayerEditMode)[seed % 3])
    dice = random.Random(seed)
    layers = {one.GetDisplayName(): one for one in context.get_stage().GetLayerStack(False)}
    paths = [(layer, f"/World/{prim}.{name}") for layer in ("root.usda", "strong.usda")
             for prim in ("Ball", "New") for name in "ab"]
    for layer, path in paths[::2]:
        number(layers[layer], path, 0.0)
    synced(context, ada)
    values = dict.fromkeys(paths[::2], 0.0) | dict.fromkeys(paths[1::2])
    theirs = dict.fromkeys(paths, 0)  # when the colleague has written last
    done, undone = [], []  # (when, written, replaced): of each command

    def check():
        synced(context, ada)
        have = {(layer, path): spec.default if (spec := layers[layer].GetAttributeAtPath(path)) else None
                for layer, path in paths}
        assert have == values

    def reported(result, kept):
        assert result and kept <= {(os.path.basename(one.layer), one.path) for one in result.kept}

    for now in range(1, 40):
        action = dice.choice(["do", "undo", "redo", "colleague", "colleague", "rename"])
        if action == "do":
            written = {path: dice.choice([1.0, 2.0, None]) for path in dice.sample(paths, 2)}
            write(context, ada, lambda _, w=written: [number(layers[layer], path, value)
                                                      for (layer, path), value in w.items()])
            done.append((now, written, {path: values[path] for path in written}))
            undone.clear()
            values |= written
        elif action == "colleague":
            path = dice.choice(paths)
            new = [dice.choice([3.0, None]), values[path]] if dice.random() < 0.6 else [dice.choice([1.0, 2.0])]
            before = values[path]
            for value in new:
                if value != before:
                    theirs[path] = now
                before = value
            colleague(context, ada, *(f"number({path[1]!r}, {value}, layer({path[0]!r}))" for value in new))
            values[path] = new[-1]
        elif action == "rename":  # away, and back with the same values, one of which they have written
            path = at, attribute = dice.choice(paths)
            prim, name = attribute.split(".")
            if values[path] is not None:
                colleague(context, ada, f"layer({at!r}).GetPrimAtPath({prim!r}).name = 'Other'",
                          f"number('/World/Other.{name}', 9.0, layer({at!r}))",
                          f"number('/World/Other.{name}', {values[path]}, layer({at!r}))",
                          f"layer({at!r}).GetPrimAtPath('/World/Other').name = {os.path.basename(prim)!r}")
                theirs[path] = now
        elif action == "undo" and done:
            when, written, replaced = done.pop()
            undone.append((when, written))
            kept = set()
            for path, value in written.items():
                if replaced[path] == value:
                    continue
                if theirs[path] <= when and values[path] == value:
                    values[path] = replaced[path]
                elif values[path] != replaced[path]:
                    kept.add(path)
            reported(undo.undo("test"), kept)
        elif action == "redo" and undone:
            when, written = undone.pop()
            replaced = {path: values[path] for path in written}
            kept = {path for path in written if theirs[path] > when and values[path] != written[path]}
            reported(undo.redo("test"), kept)
            values |= {path: value for path, value in written.items() if path not in kept}
            done.append((when, {p: v for p, v in written.items() if p not in kept}, replaced))
        check()


def test_a_live_prim_is_moved_back_with_edits_of_others(live):
    context, ada = live
    assert move(path_from="/World/Ball", path_to="/World/Planet")
    synced(context, ada)
    ada.run("stage.GetPrimAtPath('/World/Planet').CreateAttribute('hers', Sdf.ValueTypeNames.Int).Set(1)")
    synced(context, ada)
    assert undo.undo("test")
    assert "int hers = 1" in synced(context, ada)["root.usda"]
    assert context.get_stage().GetAttributeAtPath("/World/Ball.hers").Get() == 1


def test_a_live_prim_that_another_one_has_moved_on_stays_there(live):
    context, ada = live
    assert move(path_from="/World/Ball", path_to="/World/Planet")
    synced(context, ada)
    ada.run("e = Usd.NamespaceEditor(stage); e.MovePrimAtPath('/World/Planet', '/World/Star')\n"
            "assert e.ApplyEdits()")
    synced(context, ada)
    result = undo.undo("test")
    assert result and [kept.path for kept in result.kept] == ["/World/Planet"]
    assert context.get_stage().GetPrimAtPath("/World/Star")


def test_a_live_layer_gets_layers_of_its_project_alone(live, caplog, tmp_path):
    context, ada = live
    root = context.get_stage().GetRootLayer().identifier
    (tmp_path / "own.usda").write_text("#usda 1.0\n")
    arguments = dict(layer_identifier=root, sublayer_position=0, transfer_root_content=False)
    refused(caplog, "CreateSublayer", "needs a path", new_layer_path="", create_or_insert=True,
            **arguments)
    refused(caplog, "CreateSublayer", "not a layer of the project", new_layer_path=str(tmp_path / "own.usda"),
            create_or_insert=False, **arguments)
    run("CreateSublayer", new_layer_path="props/prop.usda", create_or_insert=False, **arguments)
    assert "@./props/prop.usda@" in synced(context, ada)["root.usda"]
    assert undo.undo("test") and "@./props/prop.usda@," not in synced(context, ada)["root.usda"]


def test_a_live_layer_gets_a_new_layer_that_everybody_has(live, caplog, tmp_path, project):
    context, ada = live
    stage = context.get_stage()
    root = stage.GetRootLayer()
    arguments = dict(layer_identifier=root.identifier, sublayer_position=0, transfer_root_content=False,
                     create_or_insert=True)
    identifier = run("CreateSublayer", new_layer_path="fx/new.usda", **arguments)
    made = Sdf.Layer.Find(identifier)
    assert context.live.layer_name(made) == "fx/new.usda" and (project / "fx" / "new.usda").is_file()
    Sdf.CreatePrimInLayer(made, "/New").specifier = Sdf.SpecifierDef
    assert "@./fx/new.usda@" in synced(context, ada)["root.usda"]
    assert context.live.flush()
    ada.run("assert live.wait(lambda: stage.GetPrimAtPath('/New'), 20)")
    refused(caplog, "CreateSublayer", "open it, or choose another name", new_layer_path="strong.usda", **arguments)
    refused(caplog, "CreateSublayer", "cannot be created", new_layer_path=str(tmp_path.parent / "own.usda"), **arguments)
    assert undo.undo("test") and "new.usda" not in synced(context, ada)["root.usda"]
    assert undo.redo("test") and "@./fx/new.usda@" in synced(context, ada)["root.usda"]


@pytest.mark.parametrize("transfer", [False, True])
def test_a_new_layer_in_which_another_one_has_worked_stays(live, transfer):
    context, ada = live
    root = context.get_stage().GetRootLayer()
    identifier = run("CreateSublayer", layer_identifier=root.identifier, sublayer_position=0, create_or_insert=True,
                     new_layer_path="fx/new.usda", transfer_root_content=transfer)
    synced(context, ada)
    ada.run("made = layer('fx/new.usda')\n"
            "assert live.wait(lambda: made in stage.GetLayerStack() and made.permissionToEdit, 20)\n"
            "Sdf.CreatePrimInLayer(made, '/Hers').specifier = Sdf.SpecifierDef")
    ada.flush()
    synced(context, ada)
    before = texts(context.get_stage())
    for _ in range(2):
        changed_back(undo.undo("test"), [("/", None)])
        synced(context, ada)
        assert texts(context.get_stage()) == before and context.get_stage().GetPrimAtPath("/Hers")
        changed_back(undo.redo("test"), [])
        assert texts(context.get_stage()) == before
    assert Sdf.Layer.Find(identifier).GetPrimAtPath("/Hers")


# -- commands in the modes that distribute edits


class EditCommand(commands.RecordedCommand):
    """Makes seeded edits through the stage, wherever the edit target is. All modes give the same composed stage."""

    def __init__(self, seed, usd_context=""):
        super().__init__(usd_context)
        self.seed = seed

    def edit(self, recorder):
        dice, stage = random.Random(self.seed), self.stage
        recorder.touch(stage.GetEditTarget().GetLayer(), deep=True)
        for _ in range(dice.randint(1, 8)):
            self.change(stage, dice)

    @staticmethod
    def change(stage, dice):
        own = stage.DefinePrim(f"/World/Box/{dice.choice('ABC')}", "Xform")
        ball, number = stage.GetPrimAtPath("/World/Ball"), dice.random()
        old = stage.GetPrimAtPath("/World/Box/Old/Below")
        action = dice.randrange(19)
        if action == 0:
            ball.GetAttribute("mass").Set(number)  # from a reference of a weak layer
        elif action == 1:
            ball.SetCustomDataByKey(dice.choice(["weak", "new:key"]), number)
        elif action == 2:
            stage.GetPrimAtPath("/World/Below").SetActive(dice.random() < 0.5)
        elif action == 3:
            stage.GetPrimAtPath("/World/Cone").CreateAttribute("own", Sdf.ValueTypeNames.Double).Set(number)
        elif action == 4:
            stage.RemovePrim(f"/World/Box/{dice.choice(['Old', 'Older'])}")
        elif action == 5:
            own.CreateAttribute("a", Sdf.ValueTypeNames.Double).Set(number, dice.randint(0, 3))
        elif action == 6:
            own.CreateRelationship("r").SetTargets([f"/World/{dice.choice(['Ball', 'Cone'])}"])
        elif action == 7:
            own.RemoveProperty("a")
        elif action == 8:
            ball.GetAttribute("library").Set(f"{number}.mdl")
        elif action == 9:
            ball.GetAttribute("library").Clear()
        elif action == 10 and old:
            old.GetAttribute("a").Clear() if dice.random() < 0.5 else old.RemoveProperty("a")
        elif action == 11 and old:
            old.GetAttribute("times").ClearAtTime(dice.randint(0, 3))
        elif action == 12 and old:
            old.ClearCustomDataByKey("k") if dice.random() < 0.5 else old.ClearCustomData()
        elif action == 13 and old:
            old.GetRelationship("r").ClearTargets(dice.random() < 0.5)
        elif action == 17 and old:
            added = old.GetVariantSets().AddVariantSet(dice.choice("new"))
            added.AddVariant("a")
            added.SetVariantSelection("a")
            with added.GetVariantEditContext():
                old.CreateAttribute("within", Sdf.ValueTypeNames.Double).Set(number)
        elif action == 18 and old:
            old.GetReferences().AddInternalReference("/World/Cone")
            old.GetRelationship("r").AddTarget(f"/World/Cone{dice.randrange(3)}")
        elif action == 14:
            stage.RemovePrim("/World/Box/Old")
            stage.DefinePrim("/World/Box/Old").CreateAttribute("again", Sdf.ValueTypeNames.Double).Set(number)
        elif action == 15 and old:
            old.RemoveProperty("a")
            old.CreateAttribute("a", Sdf.ValueTypeNames.Int).SetDocumentation(f"again {number}")
        elif old:
            old.ClearMetadata("comment") if dice.random() < 0.5 else old.GetReferences().ClearReferences()


@pytest.fixture
def edits():
    commands.register(EditCommand)
    yield
    commands.unregister(EditCommand)


def in_mode(context, mode):
    """Opens the context's root layer as if it were shared, in the edit mode."""
    context.is_live_layer = lambda layer: True
    for name in ("Old", "Older"):
        below = context.get_stage().DefinePrim(f"/World/Box/{name}/Below")
        below.CreateAttribute("a", Sdf.ValueTypeNames.Int).Set(1)
        for name in "vw":
            below.GetVariantSets().AddVariantSet(name).AddVariant("p")
        for time in range(4):
            below.CreateAttribute("times", Sdf.ValueTypeNames.Int).Set(time, time)
        below.CreateRelationship("r").SetTargets(["/World/Ball"])
        below.SetCustomData({"k": 1, "l": {"m": 2}})
        below.SetMetadata("comment", "old")
        below.GetReferences().AddReference("./props/prop.usda", "/Prop")
    get_layers(context).set_edit_mode(mode)
    return context.get_stage()


def change_as_a_colleague(stage, dice):
    """Writes to the root layer, as a live client does: into what the command has edited, and beside it."""
    root = stage.GetRootLayer()
    names = [path for path in ("/World", "/World/Box", "/World/Ball", "/World/Box/A", "/World/Box/B",
                                 "/World/Box/Old/Below")
             if stage.GetPrimAtPath(path)]
    for path in dice.sample(names, 2):
        spec = Sdf.CreatePrimInLayer(root, path)
        attribute = spec.attributes.get("hers") or Sdf.AttributeSpec(spec, "hers", Sdf.ValueTypeNames.Double)
        attribute.default = dice.random()
        Sdf.CreatePrimInLayer(root, f"{path}/Hers").specifier = Sdf.SpecifierDef


def steps_of(context, mode, seed):
    """Returns the composed stage after each step: do, undo and redo, with a colleague in between."""
    stage, dice, seen = in_mode(context, mode), random.Random(seed), []

    def step(succeeded):
        assert succeeded
        app.get_app().update()
        below = stage.GetPrimAtPath("/World/Box/Old/Below")
        seen.append(composed(stage) | {"references": below and below.GetMetadata("references")})

    before = texts(stage)
    for _ in range(2):
        step(commands.execute("Edit", seed=seed, usd_context=context)[0])
        step(undo.undo(context))
        assert texts(stage) == before
    for _ in range(2):
        step(undo.redo(context) if undo.can_redo(context) else
             commands.execute("Edit", seed=seed, usd_context=context)[0])
        change_as_a_colleague(stage, dice)
        step(undo.undo(context))
    return seen


@pytest.mark.parametrize("seed", range(int(os.environ.get("USDLIVE_COMMAND_SEEDS", "40"))))
@pytest.mark.parametrize("mode", [LayerEditMode.AUTO_AUTHORING, LayerEditMode.SPECS_LINKING])
def test_any_command_is_undone_as_in_the_normal_mode(mode, seed, folder, tmp_path_factory, edits):
    copy = tmp_path_factory.mktemp("copy")
    shutil.copytree(folder, copy, dirs_exist_ok=True)
    seen = []
    for place, one in ((folder, LayerEditMode.NORMAL), (copy, mode)):
        context = omni_usd.create_context(one.name)
        assert context.open_stage(str(place / "root.usda"))
        seen.append(steps_of(context, one, seed))
        omni_usd.destroy_context(one.name)
    for step, (found, normal) in enumerate(zip(seen[1], seen[0])):
        plain = {path: str(value).replace(str(copy), str(folder)) for path, value in found.items()}
        assert plain == {path: str(value) for path, value in normal.items()}, step


def ball_or_box(dice):
    return dice.choice(["/World/Ball", "/World/Box", "/World/Box/Old"])


#: The arguments of each of our commands. `at` has the paths of the layers by name.
ARGUMENTS = {
    "SetEditTarget": lambda dice, at: dict(layer_identifier=at[dice.choice(["strong", "weak"])]),
    "CreateSublayer": lambda dice, at: dict(
        layer_identifier=at[dice.choice(["root", "weak"])], sublayer_position=dice.choice([0, 1, -1]),
        new_layer_path=at["new"], transfer_root_content=dice.random() < 0.5,
        create_or_insert=True, layer_name=dice.choice(["", "name"])),
    "RemoveSublayer": lambda dice, at: dict(layer_identifier=at["root"], sublayer_position=dice.choice([0, 1])),
    "ReplaceSublayer": lambda dice, at: dict(layer_identifier=at["root"], sublayer_position=dice.choice([0, 1]),
                                             new_layer_path=at["prop"]),
    "MoveSublayer": lambda dice, at: dict(
        from_parent_layer_identifier=at["root"], from_sublayer_position=0, to_sublayer_position=-1,
        to_parent_layer_identifier=at[dice.choice(["root", "weak"])], remove_source=True),
    "MergeLayers": lambda dice, at: dict(
        dst_parent_layer_identifier=at["root"], src_parent_layer_identifier=at["root"],
        dst_layer_identifier=at["strong"], src_layer_identifier=at["weak"], dst_stronger_than_src=dice.random() < 0.5),
    "FlattenLayers": lambda dice, at: {},
    "CreateLayerReference": lambda dice, at: dict(
        layer_identifier=at[dice.choice(["root", "strong"])], path_to=dice.choice(["/World/New", "/World/Ball"]),
        asset_path=dice.choice([None, at["prop"]]), prim_path=dice.choice([None, "/Prop"])),
    "RemovePrimSpec": lambda dice, at: dict(
        layer_identifier=at["root"], prim_spec_path=dice.choice(["/World/Ball", ["/World/Box", "/World/Ball"]])),
    "StitchPrimSpecsToLayer": lambda dice, at: dict(
        prim_paths=[ball_or_box(dice)], target_layer_identifier=at[dice.choice(["root", "strong", "weak"])]),
    "MovePrimSpecsToLayer": lambda dice, at: dict(
        dst_layer_identifier=at[dice.choice(["strong", "weak"])], src_layer_identifier=at["root"],
        prim_spec_path=ball_or_box(dice), dst_stronger_than_src=dice.random() < 0.5),
    "SetLayerMuteness": lambda dice, at: dict(layer_identifier=at[dice.choice(["strong", "weak"])], muted=True),
    "LockLayer": lambda dice, at: dict(layer_identifier=at[dice.choice(["strong", "weak"])], locked=True),
    "LinkSpecs": lambda dice, at: dict(spec_paths=ball_or_box(dice), hierarchy=dice.random() < 0.5,
                                       layer_identifiers=at[dice.choice(["strong", "weak"])]),
    "UnlinkSpecs": lambda dice, at: dict(spec_paths="/World/Box", layer_identifiers=at["root"]),
    "LockSpecs": lambda dice, at: dict(spec_paths="/World/Cone", hierarchy=dice.random() < 0.5),
    "UnlockSpecs": lambda dice, at: dict(spec_paths="/World/Below"),
    "MovePrim": lambda dice, at: dict(
        path_from=ball_or_box(dice), path_to=dice.choice(["/World/Moved", "/World/Cone/Moved"]),
        destructive=dice.random() < 0.7, keep_world_transform=dice.random() < 0.5),
    "ReorderPrim": lambda dice, at: dict(prim_path=ball_or_box(dice), position=dice.choice([0, 1, -1])),
}


def results_of(context, mode, name, seed):
    """Does, undoes and does again one command, with a colleague in between. Returns after each step the composed
    stage, the layers, and what was kept."""
    stage, dice, seen = in_mode(context, mode), random.Random(seed), []
    at = {os.path.splitext(one.GetDisplayName())[0]: one.identifier for one in stage.GetLayerStack(False)}
    folder = os.path.dirname(at["root"])
    at |= {"new": f"{folder}/new.usda", "prop": f"{folder}/props/prop.usda"}
    # A layer that the command creates is not one of a project.
    context.is_live_layer = lambda one: name != "CreateSublayer"
    get_layers(context).get_specs_linking().link_spec("/World/Box", at["root"])
    get_layers(context).get_specs_locking().lock_spec("/World/Below")
    argument = "stage_or_context" if name in ("MovePrim", "ReorderPrim") else "usd_context"

    def step(result):
        app.get_app().update()
        kept = sorted((str(one).replace(folder, ""), one.reason) for one in getattr(result, "kept", ()))
        content = {key.replace(folder, ""): text.replace(folder, "") for key, text in texts(stage).items()
                   if not key.startswith("anon:")}
        shown = {path: str(value).replace(folder, "") for path, value in composed(stage).items()}
        seen.append((bool(result), kept, content, shown, set(one.replace(folder, "") for one in stage.GetMutedLayers())))

    step(commands.execute(name, **{argument: context}, **ARGUMENTS[name](dice, at))[0])
    for action in (undo.undo, undo.redo, undo.undo, undo.redo, undo.undo):
        if len(seen) > 3:
            change_as_a_colleague(stage, dice)
        step(action(context))
    return seen


@pytest.mark.parametrize("seed", range(int(os.environ.get("USDLIVE_COMMAND_SEEDS", "3"))))
@pytest.mark.parametrize("name", ARGUMENTS)
def test_each_command_gives_the_same_layers_in_every_mode(name, seed, folder, tmp_path_factory):
    assert {one for one in commands.get_commands() if not one.startswith("Abstract")} <= {*ARGUMENTS}
    seen = []
    for mode in LayerEditMode:
        copy = tmp_path_factory.mktemp("copy")
        shutil.copytree(folder, copy, dirs_exist_ok=True)
        context = omni_usd.create_context(mode.name)
        assert context.open_stage(str(copy / "root.usda"))
        seen.append(results_of(context, mode, name, seed))
        omni_usd.destroy_context(mode.name)
    for found in seen[1:]:
        for step, (one, normal) in enumerate(zip(found, seen[0])):
            for part, wanted in zip(one, normal):
                assert part == wanted, step


@pytest.mark.parametrize("suspended", [False, True])
@pytest.mark.parametrize("mode", [LayerEditMode.AUTO_AUTHORING, LayerEditMode.SPECS_LINKING])
def test_a_prim_is_removed_and_defined_again_in_one_command(ctx, stage, layer, mode, suspended):
    class RenewCommand(commands.RecordedCommand):
        def edit(self, recorder):
            assert self.stage.RemovePrim("/World/Ball") and not self.stage.GetPrimAtPath("/World/Ball")
            self.stage.DefinePrim("/World/Ball", "Sphere").CreateAttribute("radius", Sdf.ValueTypeNames.Double)

    get_layers(ctx).set_edit_mode(mode)
    if suspended:
        get_layers(ctx).get_auto_authoring().suspend()
    commands.register(RenewCommand)
    with Undone(stage):
        run("Renew")
        renewed = layer("root").GetPrimAtPath("/World/Ball")
        assert renewed.typeName == "Sphere" and list(renewed.properties.keys()) == ["radius"]
        assert not layer("strong").GetPrimAtPath("/World/Ball") and not layer("weak").GetPrimAtPath("/World/Ball")
        assert stage.GetAttributeAtPath("/World/Ball.radius").Get() == 1  # the fallback of the schema
    commands.unregister(RenewCommand)


@pytest.mark.parametrize("suspended", [False, True])
def test_opinions_of_several_layers_and_of_commands_within_a_command_are_undone(ctx, stage, layer, suspended):
    values = {"/World/Ball.radius": 7.0, "/World/Ball.mass": 8.0, "/World/Below.a": Sdf.AssetPath("./y.png")}

    class SetValueCommand(commands.RecordedCommand):
        def __init__(self, paths, usd_context=""):
            super().__init__(usd_context)
            self.paths = paths

        def edit(self, recorder):
            recorder.touch(self.stage.GetEditTarget().GetLayer(), self.paths[0])
            self.stage.GetAttributeAtPath(self.paths[0]).Set(values[self.paths[0]])
            if self.paths[1:]:
                run("SetValue", paths=self.paths[1:])

    get_layers(ctx).set_edit_mode(LayerEditMode.AUTO_AUTHORING)
    if suspended:
        get_layers(ctx).get_auto_authoring().suspend()
    commands.register(SetValueCommand)
    with Undone(stage):
        run("SetValue", paths=list(values))
        assert layer("root").GetAttributeAtPath("/World/Ball.radius").default == 7
        assert layer("root").GetAttributeAtPath("/World/Ball.mass").default == 8
        assert layer("deep/below").GetAttributeAtPath("/World/Below.a").default == values["/World/Below.a"]
    assert stage.GetAttributeAtPath("/World/Ball.radius").Get() == 1
    commands.unregister(SetValueCommand)


@pytest.mark.parametrize("destructive", [True, False])
def test_move_a_prim_in_auto_authoring(ctx, stage, layer, destructive):
    UsdGeom.Xformable(stage.DefinePrim("/Group", "Xform")).AddTranslateOp().Set((1, 2, 3))
    get_layers(ctx).set_edit_mode(LayerEditMode.AUTO_AUTHORING)
    with Undone(stage):
        assert move(path_from="/World/Ball", path_to="/Group/Ball", destructive=destructive)
        world = UsdGeom.XformCache().GetLocalToWorldTransform(stage.GetPrimAtPath("/Group/Ball"))
        assert world.ExtractTranslation() == (0, 0, 0)
    assert stage.GetPrimAtPath("/Group") and stage.GetPrimAtPath("/World/Ball").IsActive()


def test_a_live_prim_is_moved_back_in_auto_authoring_with_edits_of_others(live):
    context, ada = live
    stage = context.get_stage()
    UsdGeom.Xformable(stage.DefinePrim("/Group", "Xform")).AddTranslateOp().Set((1, 2, 3))
    get_layers(context).set_edit_mode(LayerEditMode.AUTO_AUTHORING)
    before = synced(context, ada)
    for again in (lambda: move(path_from="/World/Ball", path_to="/Group/Ball"), lambda: undo.redo("test")):
        assert again()
        moved = synced(context, ada)
        assert undo.undo("test") and synced(context, ada) == before
    assert undo.redo("test") and synced(context, ada) == moved
    ada.run("stage.DefinePrim('/Group/Hers')\n"
            "stage.GetPrimAtPath('/Group').CreateAttribute('hers', Sdf.ValueTypeNames.Int).Set(1)")
    synced(context, ada)
    result = undo.undo("test")
    assert result and not result.kept
    synced(context, ada)
    assert stage.GetPrimAtPath("/Group/Hers") and stage.GetAttributeAtPath("/Group.hers").Get() == 1
    assert stage.GetAttributeAtPath("/World/Ball.radius").Get() == 1 and not stage.GetPrimAtPath("/Group/Ball")


def test_a_clear_in_auto_authoring_reaches_the_project_and_its_undo_keeps_what_others_wrote_since(live):
    class ClearCommand(commands.RecordedCommand):
        def edit(self, recorder):
            ball = self.stage.GetPrimAtPath("/World/Ball")
            ball.GetAttribute("radius").Clear()
            ball.RemoveProperty("size")
            ball.ClearCustomDataByKey("weak")

    context, ada = live
    get_layers(context).set_edit_mode(LayerEditMode.AUTO_AUTHORING)
    commands.register(ClearCommand)
    before = synced(context, ada)
    run("Clear")
    cleared = synced(context, ada)
    assert "radius = 1" not in cleared["root.usda"] and "radius = 2" in cleared["strong.usda"], "the strongest opinion"
    assert "size" not in cleared["strong.usda"] and "int weak" not in cleared["weak.usda"]
    changed_back(undo.undo("test"), [])
    assert synced(context, ada) == before
    changed_back(undo.redo("test"), [])
    assert synced(context, ada) == cleared
    colleague(context, ada, "number('/World/Ball.radius', 3.0)")
    changed_back(undo.undo("test"), [("/World/Ball.radius", "default")])
    assert "radius = 3" in synced(context, ada)["root.usda"]
    commands.unregister(ClearCommand)
