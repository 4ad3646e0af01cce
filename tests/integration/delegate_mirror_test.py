"""Compares a stage with a delegate layer with a second stage of the same layers without one.

A case is a random list of steps: edits of the editor, also in the context of a variant, edits of colleagues in
the layers, removals and their undo, mutes and sublayers. The layers are in different folders, so that a relative
path means another file in each. After each frame both stages must show the same. A list that fails is shrunk.
"""

from __future__ import annotations

import itertools
import os
import pathlib
import random
import tempfile
import typing

import pytest
from pxr import Sdf, Tf, Usd
from stage_context import StageContext

import usdlive.omni.kit.usd.layers as layers
from usdlive.omni.kit.app import get_app

CASES = int(os.environ.get("USDLIVE_MIRROR_CASES", "300"))
PARTS = 10
LAYERS = ["session", "root", "strong", "middle", "weak", "nested"]
PRIMS = ["/A", "/A/B", "/A/B/C", "/D", "/R", "/R/Child"]
NAMES = ["x", "y"]
SPECIFIERS = [Sdf.SpecifierDef, Sdf.SpecifierOver, Sdf.SpecifierClass]
Step = tuple[typing.Any, ...]

FILES = tempfile.TemporaryDirectory()
NUMBERS = itertools.count()
for folder in LAYERS[1:]:
    (pathlib.Path(FILES.name) / folder).mkdir()
    (pathlib.Path(FILES.name) / folder / "texture.png").touch()
    (pathlib.Path(FILES.name) / folder / "asset.usda").write_text(
        f'#usda 1.0\ndef "Asset" {{\n string folder = "{folder}"\n def "Part" {{\n }}\n}}\n')


def new_layer(name: str) -> Sdf.Layer:
    if name == "session":
        return Sdf.Layer.CreateAnonymous("session.usda")
    return Sdf.Layer.CreateNew(f"{FILES.name}/{name}/{next(NUMBERS)}.usda")


class Pair:
    """Two stages on the same layers. The session layers of the two differ, and have a common sublayer."""

    def __init__(self, mode: layers.LayerEditMode):
        self.layers = {name: new_layer(name) for name in LAYERS}
        self.removed: list[tuple[str, str, Sdf.Layer]] = []
        self.asset = Sdf.Layer.CreateAnonymous("asset.usda")
        asset = Usd.Stage.Open(self.asset)
        asset.DefinePrim("/Asset", "Xform").CreateAttribute("x", Sdf.ValueTypeNames.Double).Set(1.0)
        asset.DefinePrim("/Asset/Child").CreateAttribute("x", Sdf.ValueTypeNames.Double).Set(2.0)
        root = self.layers["root"]
        for name in ("strong", "middle", "weak"):
            root.subLayerPaths.append(self.layers[name].identifier)
        root.subLayerOffsets[1] = Sdf.LayerOffset(10, 2)
        self.layers["middle"].subLayerPaths.append(self.layers["nested"].identifier)
        prim = Sdf.CreatePrimInLayer(self.layers["weak"], "/R")
        prim.specifier = Sdf.SpecifierDef
        prim.referenceList.prependedItems.append(Sdf.Reference(self.asset.identifier, "/Asset"))
        prim = Sdf.CreatePrimInLayer(self.layers["weak"], "/A")
        prim.specifier = Sdf.SpecifierDef
        for set_name in "vw":
            prim.variantSetNameList.prependedItems.append(set_name)
            variants = Sdf.VariantSetSpec(prim, set_name)
            for name in "pq":
                variant = Sdf.VariantSpec(variants, name).primSpec
                Sdf.AttributeSpec(variant, "x", Sdf.ValueTypeNames.Double).default = 5.0
        sessions = [Sdf.Layer.CreateAnonymous("session.usda") for _ in range(2)]
        for session in sessions:
            session.subLayerPaths.append(self.layers["session"].identifier)
        self.stage, self.oracle = (Usd.Stage.Open(root, session) for session in sessions)
        self.context = StageContext(self.stage, "mirror")
        self.instance = layers.get_layers(self.context)
        self.instance.set_edit_mode(mode)
        get_app().update()
        target = self.stage.GetEditTarget().GetLayer().identifier
        assert self.instance.get_auto_authoring().is_auto_authoring_layer(target)

    def take(self, step: Step) -> None:
        try:
            getattr(self, step[0])(*step[1:])
        except Tf.ErrorException:
            pass  # OpenUSD refuses it, for example below an inactive prim

    # -- steps of the editor

    def set_value(self, path: str, name: str, value: float, time: float | None) -> None:
        prim = self.stage.GetPrimAtPath(path)
        if prim:
            attribute = prim.GetAttribute(name) or prim.CreateAttribute(name, Sdf.ValueTypeNames.Double)
            attribute.Set(value, Usd.TimeCode.Default() if time is None else time)

    def in_variant(self, name: str, value: float) -> None:
        sets = self.stage.GetPrimAtPath("/A").GetVariantSets() if self.stage.GetPrimAtPath("/A") else None
        if sets and sets.GetVariantSelection("v") and "v" in sets.GetNames():
            with sets.GetVariantSet("v").GetVariantEditContext():
                self.set_value("/A", name, value, None)

    def in_variant_child(self, specifier: Sdf.Specifier) -> None:
        sets = self.stage.GetPrimAtPath("/A").GetVariantSets() if self.stage.GetPrimAtPath("/A") else None
        if sets and sets.GetVariantSelection("v") and "v" in sets.GetNames():
            with sets.GetVariantSet("v").GetVariantEditContext():
                self.stage.DefinePrim("/A/B", "Cube").SetSpecifier(specifier)

    def define(self, path: str, kind: str) -> None:
        self.stage.DefinePrim(path, kind)

    def override(self, path: str) -> None:
        self.stage.OverridePrim(path)

    def add_variant(self, path: str, value: float) -> None:
        if self.stage.GetPrimAtPath(path):
            added = self.stage.GetPrimAtPath(path).GetVariantSets().AddVariantSet("n")
            added.AddVariant("a")
            added.SetVariantSelection("a")
            with added.GetVariantEditContext():
                self.set_value(path, "x", value, None)

    def rename(self, path: str, name: str) -> None:
        editor = Usd.NamespaceEditor(self.stage)
        if self.stage.GetPrimAtPath(path) and editor.MovePrimAtPath(path, Sdf.Path(path).ReplaceName(name)):
            if editor.CanApplyEdits():
                editor.ApplyEdits()

    def specify(self, path: str, specifier: Sdf.Specifier) -> None:
        if self.stage.GetPrimAtPath(path):
            self.stage.GetPrimAtPath(path).SetSpecifier(specifier)

    def select(self, set_name: str, name: str) -> None:
        if self.stage.GetPrimAtPath("/A"):
            self.stage.GetPrimAtPath("/A").GetVariantSet(set_name).SetVariantSelection(name)

    def annotate(self, path: str, key: str, value: int) -> None:
        if self.stage.GetPrimAtPath(path):
            self.stage.GetPrimAtPath(path).SetCustomDataByKey(key, value)

    def activate(self, path: str, active: bool) -> None:
        if self.stage.GetPrimAtPath(path):
            self.stage.GetPrimAtPath(path).SetActive(active)

    def remove(self, path: str) -> None:
        self.stage.RemovePrim(path)

    def target(self, path: str, name: str) -> None:
        if self.stage.GetPrimAtPath(path):
            prim = self.stage.GetPrimAtPath(path)
            (prim.GetRelationship("to") or prim.CreateRelationship("to")).AddTarget(f"/{name}")

    def untarget(self, path: str, name: str) -> None:
        if self.stage.GetPrimAtPath(path) and self.stage.GetPrimAtPath(path).GetRelationship("to"):
            self.stage.GetPrimAtPath(path).GetRelationship("to").RemoveTarget(f"/{name}")

    def connect(self, path: str, name: str) -> None:
        if self.stage.GetPrimAtPath(path):
            prim = self.stage.GetPrimAtPath(path)
            attribute = prim.GetAttribute(name) or prim.CreateAttribute(name, Sdf.ValueTypeNames.Double)
            attribute.AddConnection("/D.x")

    def set_asset(self, path: str, file: str, form: str) -> None:
        prim, asset, types = self.stage.GetPrimAtPath(path), Sdf.AssetPath(file), Sdf.ValueTypeNames
        if not prim:
            return
        if form == "value":
            (prim.GetAttribute("file") or prim.CreateAttribute("file", types.Asset)).Set(asset)
        elif form == "sample":
            (prim.GetAttribute("file") or prim.CreateAttribute("file", types.Asset)).Set(asset, 3.0)
        elif form == "array":
            (prim.GetAttribute("files") or prim.CreateAttribute("files", types.AssetArray)).Set([asset])
        else:
            prim.SetAssetInfoByKey("identifier", asset)

    def refer(self, path: str, add: bool) -> None:
        if self.stage.GetPrimAtPath(path):
            references = self.stage.GetPrimAtPath(path).GetReferences()
            (references.AddReference if add else references.RemoveReference)(Sdf.Reference("./asset.usda", "/Asset"))

    def load(self, path: str) -> None:
        if self.stage.GetPrimAtPath(path):
            self.stage.GetPrimAtPath(path).GetPayloads().AddPayload("./asset.usda", "/Asset")

    def declare(self, path: str, name: str) -> None:
        if self.stage.GetPrimAtPath(path):
            self.stage.GetPrimAtPath(path).CreateAttribute(name, Sdf.ValueTypeNames.Double)
            self.stage.GetPrimAtPath(path).CreateRelationship("to")

    def clear(self, path: str, name: str) -> None:
        if self.stage.GetPrimAtPath(path) and self.stage.GetPrimAtPath(path).GetAttribute(name):
            self.stage.GetPrimAtPath(path).GetAttribute(name).Clear()

    def block(self, path: str, name: str) -> None:
        if self.stage.GetPrimAtPath(path) and self.stage.GetPrimAtPath(path).GetAttribute(name):
            self.stage.GetPrimAtPath(path).GetAttribute(name).Block()

    def remove_property(self, path: str, name: str) -> None:
        if self.stage.GetPrimAtPath(path):
            self.stage.GetPrimAtPath(path).RemoveProperty(name)

    def apply_schema(self, path: str) -> None:
        if self.stage.GetPrimAtPath(path):
            self.stage.GetPrimAtPath(path).AddAppliedSchema("ModelAPI")

    def lock(self, name: str, locked: bool) -> None:
        self.instance.get_layers_state().set_layer_lock_state(self.layers[name].identifier, locked)

    def default(self, name: str) -> None:
        self.instance.get_auto_authoring().set_default_layer(self.layers[name].identifier)

    def mute(self, name: str, muted: bool) -> None:
        identifier = self.layers[name].identifier
        self.stage.MuteLayer(identifier) if muted else self.stage.UnmuteLayer(identifier)

    def scope(self, everywhere: bool) -> None:
        self.instance.get_layers_state().set_muteness_scope(everywhere)

    # -- steps of colleagues

    def their_value(self, layer: str, path: str, name: str, value: float, time: float | None) -> None:
        prim = Sdf.CreatePrimInLayer(self.layers[layer], path)
        spec = prim.attributes.get(name) or Sdf.AttributeSpec(prim, name, Sdf.ValueTypeNames.Double)
        if time is None:
            spec.default = value
        else:
            self.layers[layer].SetTimeSample(spec.path, time, value)

    def their_specifier(self, layer: str, path: str, specifier: Sdf.Specifier, kind: str) -> None:
        prim = Sdf.CreatePrimInLayer(self.layers[layer], path)
        prim.specifier = specifier
        if kind:
            prim.typeName = kind

    def their_selection(self, layer: str, set_name: str, name: str) -> None:
        Sdf.CreatePrimInLayer(self.layers[layer], "/A").variantSelections[set_name] = name

    def their_removal(self, layer: str, path: str) -> None:
        edit = Sdf.BatchNamespaceEdit()
        edit.Add(path, Sdf.Path.emptyPath)
        if self.layers[layer].GetObjectAtPath(path):
            before = Sdf.Layer.CreateAnonymous(".usda")
            before.TransferContent(self.layers[layer])
            self.removed.append((layer, path, before))
            self.layers[layer].Apply(edit)

    def their_rename(self, layer: str, path: str, name: str) -> None:
        edit = Sdf.BatchNamespaceEdit()
        edit.Add(path, Sdf.Path(path).ReplaceName(name))
        if self.layers[layer].GetObjectAtPath(path):
            self.layers[layer].Apply(edit)

    def their_undo(self) -> None:
        if self.removed:
            layer, path, before = self.removed.pop()
            Sdf.CreatePrimInLayer(self.layers[layer], Sdf.Path(path).GetPrimPath())
            Sdf.CopySpec(before, path, self.layers[layer], path)

    def their_replacement(self, layer: str) -> None:
        if self.removed and self.removed[-1][0] == layer:
            self.layers[layer].ImportFromString(self.removed.pop()[2].ExportToString())

    def their_asset(self, layer: str, path: str, file: str) -> None:
        prim = Sdf.CreatePrimInLayer(self.layers[layer], path)
        spec = prim.attributes.get("file") or Sdf.AttributeSpec(prim, "file", Sdf.ValueTypeNames.Asset)
        spec.default = Sdf.AssetPath(file)

    def their_variant(self, layer: str, name: str, value: float) -> None:
        self.their_value(layer, f"/A{{v={name}}}", "x", value, None)

    def their_offset(self, offset: float) -> None:
        if len(self.layers["root"].subLayerPaths) > 1:
            self.layers["root"].subLayerOffsets[1] = Sdf.LayerOffset(offset, 2)

    def their_rate(self, layer: str, rate: float) -> None:
        self.layers[layer].timeCodesPerSecond = rate

    def their_sublayer(self, name: str, used: bool) -> None:
        paths, identifier = self.layers["root"].subLayerPaths, self.layers[name].identifier
        if used and identifier not in paths:
            paths.append(identifier)
        elif not used and identifier in paths:
            paths.remove(identifier)

    def their_target(self, layer: str, path: str, name: str) -> None:
        prim = Sdf.CreatePrimInLayer(self.layers[layer], path)
        spec = prim.relationships.get("to") or Sdf.RelationshipSpec(prim, "to")
        spec.targetPathList.Append(f"/{name}")

    def their_mute(self, name: str, muted: bool) -> None:
        root = self.layers["root"]
        data = dict(root.customLayerData)
        flags = dict(data.get("omni_layer", {}).get("muteness", {}))
        flags[self.layers[name].identifier] = muted
        data["omni_layer"] = {**data.get("omni_layer", {}), "muteness": flags}
        root.customLayerData = data

    # -- what the stages show

    def frame(self) -> None:
        get_app().update()
        wanted = set(self.stage.GetMutedLayers())
        now = set(self.oracle.GetMutedLayers())
        self.oracle.MuteAndUnmuteLayers(list(wanted - now), list(now - wanted))
        with_delegate, without = shown(self.stage), shown(self.oracle)
        if with_delegate != without:
            paths = [p for p in {**with_delegate, **without} if with_delegate.get(p) != without.get(p)]
            raise Difference([(p, with_delegate.get(p), without.get(p)) for p in paths])


class Difference(AssertionError):
    pass


def shown(stage: Usd.Stage) -> dict[str, dict[str, str]]:
    """The composed fields of all specs, with resolved paths, without the order of children."""
    flat = stage.Flatten(addSourceFileComment=False)
    found: dict[str, dict[str, str]] = {}

    def visit(path: Sdf.Path) -> None:
        spec = flat.GetObjectAtPath(path)
        if spec and path != Sdf.Path.absoluteRootPath:
            found[str(path)] = {key: str(spec.GetInfo(key)) for key in spec.ListInfoKeys()
                                if not key.endswith("Children")}

    flat.Traverse("/", visit)
    for prim in stage.TraverseAll():
        files = [attribute.Get() for attribute in prim.GetAttributes() if attribute.GetName().startswith("file")]
        files += [attribute.Get(3.0) for attribute in prim.GetAttributes() if attribute.GetName() == "file"]
        found[f"files of {prim.GetPath()}"] = {"": repr(files) + repr(prim.GetAssetInfo())}
    return found


def random_step(rng: random.Random) -> Step:
    prim, layer, name = rng.choice(PRIMS), rng.choice(LAYERS), rng.choice(NAMES)
    value, time = float(rng.randrange(1000)), rng.choice([None, None, None, float(rng.randrange(20))])
    specifier, kind, variant = rng.choice(SPECIFIERS), rng.choice(["Xform", "Cube", ""]), rng.choice("pq")
    muted, file = rng.random() < 0.5, rng.choice(["./texture.png", "./texture.png", "texture.png", ""])
    return rng.choice([
        ("set_value", prim, name, value, time), ("set_value", prim, name, value, time),
        ("in_variant", name, value), ("in_variant_child", specifier),
        ("define", prim, kind), ("override", prim), ("specify", prim, specifier),
        ("select", rng.choice("vw"), variant), ("annotate", prim, name, rng.randrange(100)),
        ("activate", prim, muted), ("remove", prim), ("mute", rng.choice(LAYERS[2:]), muted), ("scope", muted),
        ("their_value", layer, prim, name, value, time), ("their_value", layer, prim, name, value, time),
        ("their_specifier", layer, prim, specifier, kind), ("their_selection", layer, rng.choice("vw"), variant),
        ("their_removal", layer, prim), ("their_variant", rng.choice(LAYERS), variant, value),
        ("their_mute", rng.choice(LAYERS[2:]), muted), ("target", prim, name), ("apply_schema", prim),
        ("their_target", layer, prim, name), ("their_offset", time or 0.0), ("their_rate", layer, rng.choice([24, 48])),
        ("their_sublayer", rng.choice(LAYERS[2:]), muted), ("their_undo",), ("their_undo",),
        ("their_replacement", layer), ("add_variant", prim, value), ("rename", prim, rng.choice("DQ")),
        ("their_rename", layer, prim, rng.choice("DQ")), ("untarget", prim, name), ("connect", prim, name),
        ("set_asset", prim, file, rng.choice(["value", "sample", "array", "info"])), ("refer", prim, muted),
        ("their_asset", layer, prim, file), ("load", prim), ("clear", prim, name), ("declare", prim, name),
        ("lock", layer, muted and value < 500), ("default", layer), ("block", prim, name),
        ("remove_property", prim, name), ("their_removal", layer, f"{prim}.{name}"), ("frame",), ("frame",), ("frame",), ("frame",)])


def failure(steps: list[Step], mode: layers.LayerEditMode) -> str:
    pair = Pair(mode)
    try:
        for step in [*steps, ("frame",)]:
            pair.take(step)
    except Difference as difference:
        return str(difference)
    finally:
        pair.instance.set_edit_mode(layers.LayerEditMode.NORMAL)
    return ""


def shrunk(steps: list[Step], mode: layers.LayerEditMode) -> list[Step]:
    """Removes steps as long as the rest still fails."""
    size = len(steps) // 2
    while size:
        at = 0
        while at < len(steps):
            fewer = steps[:at] + steps[at + size:]
            if failure(fewer, mode):
                steps = fewer
            else:
                at += size
        size //= 2
    return steps


def check(steps: list[Step], mode: layers.LayerEditMode) -> None:
    if failure(steps, mode):
        steps = shrunk(steps, mode)
        pytest.fail(f"{steps}\n(path, with the delegate, without): {failure(steps, mode)}")


def steps_of(seed: int) -> list[Step]:
    rng = random.Random(seed)
    return [random_step(rng) for _ in range(rng.randint(5, 40))]


def mode_of(seed: int) -> layers.LayerEditMode:
    return layers.LayerEditMode.SPECS_LINKING if seed % 4 == 3 else layers.LayerEditMode.AUTO_AUTHORING


#: Lists that failed once, shrunk.
FAILED = {
    "a sample over a value written in a variant": [
        ("their_selection", "session", "v", "p"), ("in_variant", "y", 492.0), ("frame",),
        ("set_value", "/A", "y", 821.0, 18.0)],
    "a specifier whose prim was removed": [
        ("define", "/A/B/C", "Cube"), ("frame",), ("specify", "/A/B/C", Sdf.SpecifierOver),
        ("their_removal", "root", "/A")],
    "a specifier that became over": [
        ("select", "v", "p"), ("their_value", "nested", "/A/B", "y", 649.0, None), ("frame",),
        ("their_specifier", "weak", "/A", Sdf.SpecifierOver, "")],
    "a local mute": [("specify", "/R", Sdf.SpecifierClass), ("frame",), ("mute", "weak", True)],
    "a colleague's mute": [("define", "/A", "Xform"), ("frame",), ("their_mute", "weak", True), ("scope", True)],
    "a scope of mutes": [("their_mute", "weak", True), ("select", "w", "p"), ("frame",), ("scope", True)],
    "a relative path of an asset": [("set_asset", "/A", "./texture.png", "value")],
    "relative paths of assets in samples": [("set_asset", "/A", "./texture.png", "sample")],
    "relative paths of assets in an array": [("set_asset", "/A", "./texture.png", "array")],
    "a relative path of an asset in metadata": [("set_asset", "/R", "./texture.png", "info")],
    "a reference with a relative path": [("refer", "/R", True)],
    "a payload with a relative path": [("load", "/R")],
    "an attribute without a value": [("declare", "/A/B", "x")],
    "a value that was cleared in the frame in which it was set": [
        ("their_target", "weak", "/A/B/C", "y"), ("frame",), ("set_value", "/A/B/C", "x", 93.0, None),
        ("clear", "/A/B/C", "x")],
    "a prim in a locked default layer": [("default", "weak"), ("lock", "weak", True), ("frame",), ("override", "/N")],
    "a refused specifier": [
        ("specify", "/R", Sdf.SpecifierClass), ("load", "/R/Child"), ("lock", "weak", True)],
    "a refused value of a prim that is removed": [
        ("default", "strong"), ("lock", "strong", True), ("remove", "/R"), ("block", "/R/Child", "x")],
    "a new set of variants": [("select", "v", "p"), ("in_variant", "y", 678.0), ("add_variant", "/A", 7.0)],
    "sublayers that only Python holds": 3 * [
        *(("their_sublayer", name, False) for name in LAYERS[2:]), ("frame",),
        *(("their_sublayer", name, True) for name in LAYERS[2:]), ("frame",)],
}


@pytest.mark.parametrize("steps", FAILED.values(), ids=FAILED.keys())
def test_what_failed_once(steps):
    check(steps, layers.LayerEditMode.AUTO_AUTHORING)


@pytest.mark.parametrize("part", range(PARTS))
def test_a_delegate_changes_nothing_that_is_shown(part):
    for seed in range(part, CASES, PARTS):
        check(steps_of(seed), mode_of(seed))
