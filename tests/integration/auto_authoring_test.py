"""Compares auto authoring with an oracle: the same edits made with plain pxr.Usd in the layer that has the
strongest opinion.

A case creates the same random stage twice. One is edited with the delegate on. On the other, each edit is
made with its own edit target, chosen from the content of the layers before the frame. Afterwards all layers
of the two must be identical, and the stage without the delegate must show the authored values.
"""

from __future__ import annotations

import dataclasses
import os
import random
import typing

import pytest
from pxr import Sdf, Usd
from stage_context import StageContext

import usdlive.omni.kit.usd.layers as layers
from usdlive.omni.kit.app import get_app

CASES = int(os.environ.get("USDLIVE_AUTHORING_CASES", "1000"))
PARTS = 10
OFFSETS = [(0, 1), (0, 1), (10, 1), (0, 2), (-4, 0.5)]
VALUE_FIELDS = ("default", "timeSamples")
PRIMS = ["/P0", "/P1", "/P2", "/P1/C"]
ATTRIBUTES = ["a", "b", "tc"]


class Case:
    """The stage of a seed, built from its own random numbers, so that two stages of one seed are equal."""

    def __init__(self, seed: int):
        rng = random.Random(seed)
        names = ["root"] + [f"sub{i}" for i in range(rng.randint(1, 7))]
        self.layers = {name: Sdf.Layer.CreateAnonymous(f"{name}.usda") for name in names}
        self.layers["session"] = Sdf.Layer.CreateAnonymous("session.usda")
        self.asset = Sdf.Layer.CreateAnonymous("asset.usda")
        self._stack(rng, names)
        self._asset()
        self._opinions(rng, names)
        self._variants(rng, names)
        self.stage = Usd.Stage.Open(self.layers["root"], self.layers["session"])
        self.default = rng.choice(names)

    def _stack(self, rng: random.Random, names: list[str]) -> None:
        for index, name in enumerate(names[1:], start=1):
            parent = self.layers["root" if rng.random() < 0.7 else names[rng.randrange(index)]]
            parent.subLayerPaths.append(self.layers[name].identifier)
            offset = Sdf.LayerOffset(*rng.choice(OFFSETS))
            parent.subLayerOffsets[len(parent.subLayerPaths) - 1] = offset
        for name in names:
            if rng.random() < 0.15:
                self.layers[name].timeCodesPerSecond = 48

    def _asset(self) -> None:
        stage = Usd.Stage.Open(self.asset)
        prim = stage.DefinePrim("/Asset", "Xform")
        prim.CreateAttribute("a", Sdf.ValueTypeNames.Double).Set(1.0)
        stage.DefinePrim("/Asset/Child").CreateAttribute("a", Sdf.ValueTypeNames.Double).Set(2.0)

    def _opinions(self, rng: random.Random, names: list[str]) -> None:
        for name in [*names, "session"]:
            layer = self.layers[name]
            for path in PRIMS:
                if rng.random() > (0.5 if name != "session" else 0.1):
                    continue
                prim = Sdf.CreatePrimInLayer(layer, path)
                if rng.random() < 0.5:
                    prim.specifier, prim.typeName = Sdf.SpecifierDef, "Xform"
                self._fill(rng, prim)
        base = self.layers[names[-1]]
        reference = Sdf.CreatePrimInLayer(base, "/R")
        reference.specifier = Sdf.SpecifierDef
        reference.referenceList.prependedItems.append(Sdf.Reference(self.asset.identifier, "/Asset"))
        if rng.random() < 0.5:
            over = Sdf.CreatePrimInLayer(self.layers[rng.choice(names)], "/R/Child")
            self._attribute(rng, over, "a")

    def _fill(self, rng: random.Random, prim: Sdf.PrimSpec) -> None:
        for attribute in ATTRIBUTES:
            if rng.random() < 0.4:
                self._attribute(rng, prim, attribute)
        if rng.random() < 0.3:
            prim.comment = f"comment {rng.randrange(100)}"
        for key in ("k", "l"):
            if rng.random() < 0.3:
                data = dict(prim.customData)
                data[key] = rng.randrange(100)
                prim.customData = data
        if rng.random() < 0.3:
            relationship = prim.relationships.get("targets") or Sdf.RelationshipSpec(prim, "targets")
            relationship.targetPathList.prependedItems.append(rng.choice(["/P0", "/P1", "/P2"]))

    def _attribute(self, rng: random.Random, prim: Sdf.PrimSpec, name: str) -> None:
        kind = Sdf.ValueTypeNames.TimeCode if name == "tc" else Sdf.ValueTypeNames.Double
        spec = Sdf.AttributeSpec(prim, name, kind, declaresCustom=True)
        what = rng.random()
        if what < 0.6:
            spec.default = Sdf.TimeCode(rng.randrange(100)) if name == "tc" else float(rng.randrange(100))
        if what > 0.4 and name != "tc":
            for _ in range(rng.randint(1, 3)):
                prim.layer.SetTimeSample(spec.path, float(rng.randrange(50)), float(rng.randrange(100)))
        if rng.random() < 0.2:
            spec.documentation = f"documentation {rng.randrange(100)}"

    def _variants(self, rng: random.Random, names: list[str]) -> None:
        self.selection = rng.choice("xy")
        for name in rng.sample(names, rng.randint(0, min(2, len(names)))):
            prim = Sdf.CreatePrimInLayer(self.layers[name], "/P0")
            prim.variantSetNameList.prependedItems.append("v")
            prim.variantSelections["v"] = self.selection
            variants = Sdf.VariantSetSpec(prim, "v")
            for variant in "xy":
                self._fill(rng, Sdf.VariantSpec(variants, variant).primSpec)

    # -- the existing opinions, by Sdf alone

    def local(self) -> list[str]:
        """The layers from strong to weak, without the delegate."""
        by_identifier = {layer.identifier: name for name, layer in self.layers.items()}
        return [by_identifier[layer.identifier] for layer in self.stage.GetLayerStack()
                if layer.identifier in by_identifier]

    def texts(self) -> dict[str, str]:
        texts = {name: layer.ExportToString() for name, layer in self.layers.items()}
        for name, layer in [*self.layers.items(), ("asset", self.asset)]:
            texts = {key: text.replace(layer.identifier, name) for key, text in texts.items()}
        return texts


@dataclasses.dataclass
class Edit:
    """One edit of a register. `fields` are those that count as opinions of the register."""

    path: str
    fields: tuple[str, ...]
    author: typing.Callable[[Usd.Stage], None]
    shown: typing.Callable[[Usd.Stage], typing.Any]
    value: typing.Any
    key: str = ""
    new: bool = False
    time: float | None = None
    clears: bool = False  # is distributed at once, together with the edits before it

    def register(self) -> tuple:
        return (self.path, self.fields, self.key)


def has(layer: Sdf.Layer, path: str, fields: tuple[str, ...]) -> bool:
    """Without fields: the layer has the spec."""
    spec = layer.GetObjectAtPath(path)
    return bool(spec) and (not fields or any(spec.HasInfo(field) for field in fields))


def place(case: Case, edit: Edit) -> tuple[str, str]:
    """The (layer, path) where the edit belongs."""
    local = [name for name in case.local() if case.layers[name].GetObjectAtPath(edit.path)]
    if not edit.fields and local:
        return local[0], edit.path
    for name in local:
        spec = case.layers[name].GetObjectAtPath(edit.path)
        if edit.key and edit.key in (spec.GetInfo(edit.fields[0]) if spec.HasInfo(edit.fields[0]) else {}):
            return name, edit.path
    for name in local:
        if has(case.layers[name], edit.path, edit.fields):
            return name, edit.path
    if edit.path.startswith("/P0"):
        within = edit.path.replace("/P0", f"/P0{{v={case.selection}}}", 1)
        for name in case.local():
            if has(case.layers[name], within, edit.fields):
                return name, within
    return (local[0] if local else case.default), edit.path


def author(case: Case, edit: Edit, there: tuple[str, str]) -> None:
    """Authors the edit like somebody who knows the layers."""
    name, path = there
    layer = case.layers[name]
    target = case.stage.GetEditTargetForLocalLayer(layer)
    if path != edit.path:
        target = Usd.EditTarget.ForLocalDirectVariant(layer, Sdf.Path(f"/P0{{v={case.selection}}}"))
    with Usd.EditContext(case.stage, target):
        edit.author(case.stage)


# -- random edits


def value_edit(rng: random.Random, case: Case) -> Edit:
    path = rng.choice([*PRIMS, "/R", "/R/Child"])
    name = "a" if path.startswith("/R") else rng.choice(["a", "b"])
    value = float(rng.randrange(1000, 2000))

    def attribute(stage: Usd.Stage) -> Usd.Attribute:
        prim = stage.GetPrimAtPath(path)
        return prim.GetAttribute(name) or prim.CreateAttribute(name, Sdf.ValueTypeNames.Double)

    time = float(rng.randrange(60)) if rng.random() < 0.5 else None
    edit = Edit(f"{path}.{name}", VALUE_FIELDS, lambda s: attribute(s).Set(value), lambda s: attribute(s).Get(),
                value)
    inside_variant = place(case, edit)[1] != edit.path
    if time is not None and not inside_variant:
        edit.author = lambda s: attribute(s).Set(value, time)
        edit.shown = lambda s: attribute(s).Get(time)
        edit.time = time
    return edit


def time_code_edit(rng: random.Random, case: Case) -> Edit | None:
    path, value = rng.choice(["/P1", "/P2"]), Sdf.TimeCode(rng.randrange(1000, 2000))

    def attribute(stage: Usd.Stage) -> Usd.Attribute:
        prim = stage.GetPrimAtPath(path)
        return prim.GetAttribute("tc") or prim.CreateAttribute("tc", Sdf.ValueTypeNames.TimeCode)

    return Edit(f"{path}.tc", VALUE_FIELDS, lambda s: attribute(s).Set(value), lambda s: attribute(s).Get(), value)


def comment_edit(rng: random.Random, case: Case) -> Edit:
    path, value = rng.choice([*PRIMS, "/R/Child"]), f"edited {rng.randrange(1000)}"
    return Edit(path, ("comment",), lambda s: s.GetPrimAtPath(path).SetMetadata("comment", value),
                lambda s: s.GetPrimAtPath(path).GetMetadata("comment"), value)


def documentation_edit(rng: random.Random, case: Case) -> Edit | None:
    path, value = rng.choice(PRIMS), f"edited {rng.randrange(1000)}"
    if not case.stage.GetPrimAtPath(path).GetAttribute("a"):
        return None
    return Edit(f"{path}.a", ("documentation",),
                lambda s: s.GetAttributeAtPath(f"{path}.a").SetMetadata("documentation", value),
                lambda s: s.GetAttributeAtPath(f"{path}.a").GetMetadata("documentation"), value)


def key_edit(rng: random.Random, case: Case) -> Edit:
    path, key, value = rng.choice(PRIMS), rng.choice(["k", "l", "new"]), rng.randrange(1000, 2000)
    return Edit(path, ("customData",), lambda s: s.GetPrimAtPath(path).SetCustomDataByKey(key, value),
                lambda s: s.GetPrimAtPath(path).GetCustomDataByKey(key), value, key=key)


def target_edit(rng: random.Random, case: Case) -> Edit | None:
    path, target = rng.choice(PRIMS), Sdf.Path(f"/Target{rng.randrange(10)}")
    if not case.stage.GetPrimAtPath(path).GetRelationship("targets"):
        return None
    place = rng.choice([Usd.ListPositionFrontOfPrependList, Usd.ListPositionBackOfPrependList,
                        Usd.ListPositionFrontOfAppendList, Usd.ListPositionBackOfAppendList])
    return Edit(f"{path}.targets", ("targetPaths",),
                lambda s: s.GetRelationshipAtPath(f"{path}.targets").AddTarget(target, place),
                lambda s: target in s.GetRelationshipAtPath(f"{path}.targets").GetTargets(), True)


def api_edit(rng: random.Random, case: Case) -> Edit:
    path = rng.choice(PRIMS)
    return Edit(path, ("apiSchemas",), lambda s: s.GetPrimAtPath(path).AddAppliedSchema("ModelAPI"),
                lambda s: [str(n) for n in s.GetPrimAtPath(path).GetPrimTypeInfo().GetAppliedAPISchemas()], ["ModelAPI"])


def prim_edit(rng: random.Random, case: Case) -> Edit:
    parent = rng.choice(["", "/P1", "/R"])
    if parent and not case.stage.GetPrimAtPath(parent).IsDefined():
        parent = ""  # Usd would also define the parent, which is an edit of another place
    path = f"{parent}/New{rng.randrange(100)}"

    def define(stage: Usd.Stage) -> None:
        stage.DefinePrim(path, "Cube").CreateAttribute("size", Sdf.ValueTypeNames.Double).Set(3.0)

    return Edit(path, ("typeName",), define, lambda s: (s.GetPrimAtPath(path).GetTypeName(),
                                                       s.GetAttributeAtPath(f"{path}.size").Get()), ("Cube", 3.0))


def variant_edit(rng: random.Random, case: Case) -> Edit | None:
    """Edits in the edit context of a variant: the edit stays inside it, in the strongest layer that has the
    variant."""
    prim = case.stage.GetPrimAtPath("/P0")
    if not prim.GetVariantSets().HasVariantSet("v"):
        return None
    path, value = f"/P0{{v={case.selection}}}.inside", float(rng.randrange(1000))

    def within(stage: Usd.Stage) -> None:
        target = stage.GetEditTarget()
        inside = Usd.EditTarget.ForLocalDirectVariant(
            target.GetLayer(), Sdf.Path(f"/P0{{v={case.selection}}}"))
        with Usd.EditContext(stage, inside):
            stage.GetPrimAtPath("/P0").CreateAttribute("inside", Sdf.ValueTypeNames.Double).Set(value)

    return Edit(path, VALUE_FIELDS, within, lambda s: s.GetAttributeAtPath("/P0.inside").Get(), value)


def clear(path: str, fields: tuple[str, ...], author: typing.Callable[[Usd.Object], typing.Any], key: str = "") -> Edit:
    """Clears a register of the prim or property, or with no fields removes the property."""
    def authored(stage: Usd.Stage) -> None:
        prim = stage.GetPrimAtPath(Sdf.Path(path).GetPrimPath())
        author(prim.GetProperty(Sdf.Path(path).name) if "." in path else prim)

    return Edit(path, fields, authored, lambda s: None, None, key=key, clears=True)


def clear_edit(rng: random.Random, case: Case) -> Edit | None:
    path = rng.choice([*PRIMS, "/R", "/R/Child"])
    prim, name = case.stage.GetPrimAtPath(path), rng.choice(["a", "b", "targets"])
    key = rng.choice("kl")
    kinds = [clear(path, ("comment",), lambda p: p.ClearMetadata("comment")),
             clear(path, ("customData",), lambda p: p.ClearCustomDataByKey(key), key)]
    if part := prim.GetProperty(name):
        spec = f"{path}.{name}"
        kinds += [clear(spec, (), lambda p: p.GetPrim().RemoveProperty(name)),
                  clear(spec, ("documentation",), lambda p: p.ClearDocumentation())]
        if name == "targets":
            kinds.append(clear(spec, ("targetPaths",), lambda p: p.ClearTargets(False)))
        else:
            times = part.GetTimeSamples()
            time = rng.choice(times) if times else 1.0
            kinds += [clear(spec, VALUE_FIELDS, lambda p: p.Clear()),
                      clear(spec, VALUE_FIELDS, lambda p: p.ClearDefault())]
            if place(case, kinds[-1])[1] == spec:  # an edit target of a variant does not map times
                kinds.append(clear(spec, VALUE_FIELDS, lambda p: p.ClearAtTime(time)))
    return rng.choice(kinds)


KINDS = [clear_edit, clear_edit, value_edit, value_edit, value_edit, time_code_edit, comment_edit, documentation_edit, key_edit,
         target_edit, api_edit, prim_edit, variant_edit]


def random_edits(rng: random.Random, case: Case) -> list[Edit]:
    edits: dict[tuple, Edit] = {}
    for _ in range(rng.randint(1, 8)):
        edit = rng.choice(KINDS)(rng, case)
        # A property that is removed is not edited in the same frame.
        if edit and not any(other.path == edit.path and not (other.fields and edit.fields)
                            for other in edits.values()):
            edits.setdefault(edit.register(), edit)
    # Creating a spec and writing it in one frame are two edits of one place.
    created = {e.path.split(".")[0] for e in edits.values() if e.fields == ("typeName",)}
    return [e for e in edits.values() if e.fields == ("typeName",) or e.path.split(".")[0] not in created]


def all_prims_exist(case: Case) -> bool:
    return all(case.stage.GetPrimAtPath(path) for path in [*PRIMS, "/R/Child"])


def flattened(case: Case) -> list[str]:
    """The composed content of the stage, without the order of its prims, which depends on the order of
    composition."""
    text = case.stage.Flatten(addSourceFileComment=False).ExportToString()
    for name, layer in [*case.layers.items(), ("asset", case.asset)]:
        text = text.replace(layer.identifier, name)
    return sorted(text.splitlines())


def batches(edits: list[Edit]) -> list[list[Edit]]:
    """Divides the edits into those that are distributed together."""
    result: list[list[Edit]] = [[]]
    for edit in edits:
        result[-1].append(edit)
        if edit.clears:
            result.append([])
    return [batch for batch in result if batch]


def run(seed: int) -> int:
    rng = random.Random(f"edits {seed}")
    mine, oracle = Case(seed), Case(seed)
    for case in (mine, oracle):
        for path in PRIMS:  # so that all prims can be edited
            if not case.stage.GetPrimAtPath(path):
                Sdf.CreatePrimInLayer(case.layers[case.local()[-1]], path)
    assert mine.texts() == oracle.texts() and all_prims_exist(mine)
    context = StageContext(mine.stage, "case")
    instance = layers.get_layers(context)
    instance.set_edit_mode(layers.LayerEditMode.AUTO_AUTHORING)
    instance.get_auto_authoring().set_default_layer(mine.layers[mine.default].identifier)
    app = get_app()
    done: dict[tuple, Edit] = {}
    for _ in range(2):
        edits = random_edits(rng, oracle)
        places: list[tuple[str, str]] = []
        for edit in edits:
            edit.author(mine.stage)
        for together in batches(edits):
            places += [place(oracle, edit) for edit in together]
            for edit, there in zip(together, places[-len(together):]):
                author(oracle, edit, there)
                if not edit.fields:
                    done = {at: one for at, one in done.items() if one.path != edit.path}
                elif edit.clears:
                    done.pop(edit.register(), None)
                else:
                    done[edit.register()] = edit
        app.update()
        expected, found = oracle.texts(), mine.texts()
        for name in found:
            if name != "session":
                assert found[name] == expected[name], (name, [(e.path, e.fields, p) for e, p in zip(edits, places)])
    for edit in done.values():
        assert edit.shown(oracle.stage) == edit.value or edit.time is not None, "the oracle itself"
    shown = [(edit.path, edit.shown(mine.stage), edit.shown(oracle.stage)) for edit in done.values()]
    assert all(with_delegate == wanted for _, with_delegate, wanted in shown), shown
    assert not instance.get_auto_authoring().refused_edits
    # At any time the delegate is an exact mirror of the layers.
    assert flattened(mine) == flattened(oracle)
    instance.set_edit_mode(layers.LayerEditMode.NORMAL)
    for edit in done.values():
        assert edit.shown(mine.stage) == edit.shown(oracle.stage), edit.path
    assert mine.texts() == oracle.texts()
    return len(done)


@pytest.mark.parametrize("part", range(PARTS))
def test_every_edit_lands_where_the_strongest_opinion_is(part):
    edits = 0
    for seed in range(part, CASES, PARTS):
        try:
            edits += run(seed)
        except Exception:
            print(f"seed {seed}: python auto_authoring_test.py {seed}")
            raise
    print(f"{CASES // PARTS} cases, {edits} edits")
    assert edits > CASES // PARTS


if __name__ == "__main__":
    import sys

    print(run(int(sys.argv[1])))
