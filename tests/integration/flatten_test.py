"""Tests `usdlive flatten`: in pxr.Usd the flat layer shows the same as the stage that it was made from."""

import os
import subprocess

import pytest
from conftest import refused, run
from pxr import Sdf, Usd
from value_stages import NAMES, RandomStage

PRIMS = Usd.TraverseInstanceProxies(Usd.PrimIsActive & Usd.PrimIsLoaded)


class ArcStage(RandomStage):
    """Adds instances, also inside instances, and relationships, connections and metadata."""

    def prim(self, layer, path, kind):
        prim = super().prim(layer, path, kind)
        choose = self.choose
        relationship = Sdf.RelationshipSpec(prim, "toward", custom=choose.random() < 0.5)
        for target in choose.sample([path, path + "/C", path + ".d", "/Elsewhere"], choose.randint(0, 3)):
            relationship.targetPathList.Append(target)
        if "f" in prim.attributes:
            prim.attributes["f"].connectionPathList.Append(path + ".d")
            prim.attributes["f"].displayName = choose.choice(["one", "two"])
        prim.customData = {"n": choose.randint(1, 3), "file": Sdf.AssetPath("./asset.usda"), "at": Sdf.TimeCode(2)}
        if choose.random() < 0.5:
            prim.SetInfo("apiSchemas", Sdf.TokenListOp.Create(
                prependedItems=[choose.choice(["ShadowAPI", "CollectionAPI:a", "UnknownAPI"])]))
        return prim

    def write(self):
        root = super().write()
        asset = Sdf.Layer.FindOrOpen(str(self.folder / f"asset{self.number}.{self.format}"))
        for name in ("One", "Two", "Three"):
            instance = self.prim(root, "/" + name, "Xform")
            instance.instanceable = True
            instance.referenceList.Prepend(Sdf.Reference(asset.identifier, "/Model", self.offset()))
        model = self.prim(asset, "/Model", "Scope")
        part = self.prim(asset, "/Model/Part", "Xform")
        part.instanceable = True
        part.referenceList.Prepend(Sdf.Reference("", "/Asset"))
        self.prim(asset, "/Model/Off", "Xform").active = False
        assert model
        root.pseudoRoot.SetInfo("upAxis", "Z")
        root.documentation = "of the root"
        for layer in (root, asset):
            layer.Save()
        return root


def shown(value):
    if isinstance(value, Sdf.AssetPath):
        return value.resolvedPath
    if isinstance(value, Sdf.AssetPathArray):
        return [path.resolvedPath for path in value]
    if isinstance(value, dict):
        return {key: shown(inner) for key, inner in value.items()}
    if isinstance(value, Sdf.TokenListOp):
        return list(value.GetAppliedItems())
    return value


def attribute(one):
    times = one.GetTimeSamples()
    at = [*times, *([-4.0, 0.0, 2.5, 30.0] if one.HasSpline() else [])]
    return {"type": one.GetTypeName(), "varies": one.GetVariability(), "custom": one.IsCustom(),
            "times": times, "spline": one.HasSpline(), "default": shown(one.Get()),
            "values": [shown(one.Get(time)) for time in at], "connections": one.GetConnections()}


def everything(stage):
    """Returns the facts that each prim and property shows, by its path."""
    found = {}
    for prim in Usd.PrimRange(stage.GetPseudoRoot(), PRIMS):
        if str(prim.GetPath()).startswith("/Flattened_Prototype_"):
            continue
        fields = {} if prim.IsPseudoRoot() else prim.GetAllAuthoredMetadata()
        found[str(prim.GetPath())] = {
            "schemas": prim.GetAppliedSchemas(), "instance": prim.IsInstance(),
            "fields": {key: shown(fields[key]) for key in sorted(fields) if key != "references"},
            "names": prim.GetPropertyNames()}
        for prop in prim.GetProperties():
            is_attribute = isinstance(prop, Usd.Attribute)
            found[str(prop.GetPath())] = attribute(prop) if is_attribute else {
                "custom": prop.IsCustom(), "targets": prop.GetTargets()}
    return found


def differences(original, flat):
    ours, theirs = everything(flat), everything(original)
    for path in sorted(ours.keys() | theirs.keys()):
        one, other = ours.get(path), theirs.get(path)
        if one is None or other is None:
            yield f"{path}: only in {'the flat layer' if other is None else 'the stage'}"
            continue
        for key in other:
            # usd-core interpolates from minus infinity before the first sample of an edited array.
            if one[key] != other[key] and "nan" not in str(other[key]):
                yield f"{path} {key}: {one[key]} and should be {other[key]}"


@pytest.mark.parametrize("seed", range(12))
def test_a_flat_layer_shows_what_its_stage_shows(tmp_path, seed):
    root = ArcStage(tmp_path, seed).write()
    run("flatten", root.realPath, "--out", str(tmp_path / "flat.usdc"))
    flat = Sdf.Layer.FindOrOpen(str(tmp_path / "flat.usdc"))
    assert not any(flat.GetCompositionAssetDependencies())
    assert list(differences(Usd.Stage.Open(root), Usd.Stage.Open(flat))) == []


def test_the_prims_are_those_of_usd_core(tmp_path):
    root = ArcStage(tmp_path, 100).write()
    ours = Sdf.Layer.CreateAnonymous(".usda")
    ours.ImportFromString(run("flatten", root.realPath))
    theirs = Usd.Stage.Open(root).Flatten()
    assert ours.documentation == theirs.documentation

    def specs(layer):
        paths = []
        layer.Traverse("/", paths.append)
        return sorted(str(path) for path in paths if "Flattened_Prototype_" not in str(path) and "[" not in str(path))

    assert specs(ours) == specs(theirs)
    assert ours.pseudoRoot.GetInfo("upAxis") == "Z"


def test_a_file_that_is_not_there_is_an_error(tmp_path):
    assert "gone.usda" in refused("flatten", os.path.join(tmp_path, "gone.usda"))
