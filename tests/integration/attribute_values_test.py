"""Compares the values of attributes that the C++ client resolves with those of pxr.Usd, on random stages."""

import os
import pathlib
import random
import subprocess

import pytest
from pxr import Sdf, Ts, Usd, Vt

PROBE = pathlib.Path(os.environ["USDLIVE_BUILD"]) / "bin" / "stage_probe"
TIMES = [-30.0, -3.0, 0.0, 0.25, 0.9999999, 1.0, 1.75, 2.0, 4.5, 7.0, 10.0, 12.5, 31.0, 100.0]
SOURCES = {
    Usd.ResolveInfoSourceNone: "none",
    Usd.ResolveInfoSourceFallback: "fallback",
    Usd.ResolveInfoSourceDefault: "default",
    Usd.ResolveInfoSourceTimeSamples: "timeSamples",
    Usd.ResolveInfoSourceValueClips: "valueClips",
    Usd.ResolveInfoSourceSpline: "spline",
}
NAMES = Sdf.ValueTypeNames
# The type of each attribute name; Sphere has fallback values for the last ones.
ATTRIBUTES = {
    "d": NAMES.Double, "f": NAMES.Float, "h": NAMES.Half, "i": NAMES.Int, "s": NAMES.String, "b": NAMES.Bool,
    "t": NAMES.TimeCode, "ts": NAMES.TimeCodeArray, "v": NAMES.Vector3f, "ds": NAMES.DoubleArray,
    "hs": NAMES.Color3hArray, "q": NAMES.Quatf, "qh": NAMES.Quath, "qs": NAMES.QuatdArray, "m": NAMES.Matrix4d,
    "file": NAMES.Asset, "files": NAMES.AssetArray, "set": NAMES.PathExpression,
    "ints": NAMES.IntArray, "radius": NAMES.Double, "visibility": NAMES.Token, "extent": NAMES.Float3Array,
}
EDITS = {NAMES.IntArray: (NAMES.Int, Vt.IntArrayEditBuilder), NAMES.DoubleArray: (NAMES.Double, Vt.DoubleArrayEditBuilder)}


class RandomStage:
    """Three files: a root with a sublayer, and an asset that both reference with offsets."""

    def __init__(self, folder, seed):
        self.choose = random.Random(seed)
        self.folder = folder
        self.number = seed

    def real(self):
        return self.choose.choice([0.0, 1.0, -1.5, 0.1, 3.75, 1e-3, 1000.0])

    def item(self, kind):
        """A single value of type `kind`."""
        choose, dimension = self.choose, kind.type.typeName
        if kind == NAMES.String:
            return choose.choice(["a", "b", ""])
        if kind == NAMES.Token:
            return choose.choice(["inherited", "invisible"])
        if kind == NAMES.Bool:
            return choose.random() < 0.5
        if kind == NAMES.Int:
            return choose.randint(-5, 5)
        if kind == NAMES.TimeCode:
            return Sdf.TimeCode(self.real())
        if kind == NAMES.Asset:
            return Sdf.AssetPath(choose.choice(["asset.usda", "./asset.usda", "missing.png", "`\"${NAME}.usda\"`", ""]))
        if kind == NAMES.PathExpression:
            return Sdf.PathExpression(choose.choice(["/A//", "B", "../A/*", "/Other//", "%_ + /A/C", "%_ - B", ""]))
        if dimension.startswith("GfQuat"):
            return kind.type.pythonClass(self.real(), *(self.real() for _ in range(3)))
        if dimension.startswith("GfMatrix"):
            return kind.type.pythonClass(*(self.real() for _ in range(16)))
        if dimension.startswith("GfVec"):
            return kind.type.pythonClass(*(self.real() for _ in range(3)))
        return self.real()

    def value(self, kind):
        if not kind.isArray:
            return self.item(kind)
        if kind in EDITS and self.choose.random() < 0.4:
            return self.edit(EDITS[kind])
        items = [self.item(kind.scalarType) for _ in range(self.choose.choice([0, 1, 2, 2, 2, 3]))]
        return kind.type.pythonClass(items)

    def edit(self, kinds):
        """An edit of a weaker array."""
        kind, builder = kinds[0], kinds[1]()
        for _ in range(self.choose.randint(1, 3)):
            what = self.choose.choice(["Append", "Prepend", "Write", "EraseRef"])
            if what == "Write":
                builder.Write(self.item(kind), self.choose.randint(0, 1))
            elif what == "EraseRef":
                builder.EraseRef(0)
            else:
                getattr(builder, what)(self.item(kind))
        return builder.FinalizeAndReset()

    def spline(self, kind):
        kind = str(kind)
        spline = Ts.Spline(kind)
        for time in self.choose.sample(range(12), self.choose.randint(1, 4)):
            knot = Ts.Knot(kind)
            knot.SetTime(time)
            knot.SetValue(self.real())
            knot.SetNextInterpolation(self.choose.choice(
                [Ts.InterpHeld, Ts.InterpLinear, Ts.InterpCurve, Ts.InterpValueBlock]))
            spline.SetKnot(knot)
        return spline

    def opinions(self, spec, kind):
        choose, layer, path = self.choose, spec.layer, spec.path
        if choose.random() < 0.45:
            value = choose.choice([Sdf.ValueBlock(), Sdf.AnimationBlock()]) if choose.random() < 0.2 else self.value(kind)
            spec.default = value
        # usd-core loses relative paths of sampled path expressions.
        if choose.random() < 0.4 and kind != NAMES.PathExpression:
            for time in choose.sample([-2, 0, 0.5, 1, 2, 5, 11], choose.randint(1, 4)):
                layer.SetTimeSample(path, time, Sdf.ValueBlock() if choose.random() < 0.15 else self.value(kind))
        if choose.random() < 0.2 and kind in (NAMES.Double, NAMES.Float, NAMES.Half):
            spec.SetSpline(self.spline(kind))

    def prim(self, layer, path, kind):
        prim = Sdf.CreatePrimInLayer(layer, path)
        if kind:
            prim.specifier, prim.typeName = Sdf.SpecifierDef, kind
        for name, attribute in ATTRIBUTES.items():
            if self.choose.random() < 0.6:
                self.opinions(Sdf.AttributeSpec(prim, name, attribute), attribute)
        return prim

    def offset(self):
        return Sdf.LayerOffset(self.choose.choice([0, 0, 10, -2.5]), self.choose.choice([1, 1, 2, 0.5, -1]))

    def layer(self, name):
        return Sdf.Layer.CreateNew(str(self.folder / name))

    def write(self):
        root, sub, asset = (self.layer(f"{name}{self.number}.usda") for name in ("root", "sub", "asset"))
        self.layer("asset.usda").Save()
        root.subLayerPaths = [sub.identifier]
        root.subLayerOffsets[0] = self.offset()
        root.expressionVariables = {"NAME": "asset"}
        if self.choose.random() < 0.5:
            sub.timeCodesPerSecond = 48
        self.prim(asset, "/Asset", "")
        self.prim(asset, "/Asset/C", "")
        self.prim(asset, "/Class", "")
        Sdf.CreatePrimInLayer(asset, "/Asset").inheritPathList.Prepend("/Class")
        self.prim(sub, "/A", "Sphere").referenceList.Prepend(
            Sdf.Reference(asset.identifier, "/Asset", self.offset()))
        self.prim(root, "/A", "")
        self.prim(root, "/A/C", "Sphere")
        other = self.prim(root, "/Other", "Sphere")
        other.referenceList.Prepend(Sdf.Reference("", "/A", self.offset()))
        other.payloadList.Prepend(Sdf.Payload(asset.identifier, "/Asset", self.offset()))
        for layer in (root, sub, asset):
            layer.Save()
        return root


def in_full(value):
    """Returns all parts of asset paths: the text of a path contains only the authored one."""
    paths = [value] if isinstance(value, Sdf.AssetPath) else value
    if not isinstance(value, (Sdf.AssetPath, Sdf.AssetPathArray)):
        return value
    return Vt.StringArray([part for path in paths for part in (path.authoredPath, path.evaluatedPath, path.resolvedPath)])


def said_of(attribute):
    info = attribute.GetResolveInfo()
    times = "".join(f" {time!r}" for time in sorted(attribute.GetTimeSamples()))
    return [SOURCES[info.GetSource()], int(info.ValueIsBlocked()), int(attribute.ValueMightBeTimeVarying()),
            [float(time) for time in times.split()]]


def differences(folder, seed):
    stage = Usd.Stage.Open(RandomStage(folder, seed).write())
    attributes = [attribute for prim in stage.Traverse() for attribute in prim.GetAttributes()]
    lines = "".join(f"{a.GetPrim().GetPath()} {a.GetName()} {a.GetPrim().GetTypeName() or '-'}\n" for a in attributes)
    output = folder / f"ours{seed}.usdc"
    ran = subprocess.run([PROBE, "values", stage.GetRootLayer().realPath, output, *map(repr, TIMES)], input=lines,
                         text=True, check=True, capture_output=True)
    layer = Sdf.Layer.FindOrOpen(str(output))
    for number, (attribute, line) in enumerate(zip(attributes, ran.stdout.splitlines(), strict=True)):
        source, blocked, varying, *times = line.split()
        said = [source, int(blocked), int(varying), [float(time) for time in times]]
        if said != said_of(attribute):
            yield f"{attribute.GetPath()}: {said} and should be {said_of(attribute)}"
        path = f"/_{number}.value"
        spec = layer.GetAttributeAtPath(path)
        ours = [spec and spec.default, *(layer.QueryTimeSample(path, time) for time in TIMES)]
        theirs = [in_full(attribute.Get()), *(in_full(attribute.Get(time)) for time in TIMES)]
        for time, found, expected in zip(["default", *TIMES], ours, theirs, strict=True):
            if "nan" in str(expected):
                continue  # usd-core interpolates from minus infinity before the first sample of an edited array
            if found != expected or type(found) is not type(expected):
                yield f"{attribute.GetPath()} at {time}: {found} and should be {expected}"


@pytest.mark.parametrize("seed", range(20))
def test_values_are_those_of_usd_core(tmp_path, seed):
    assert list(differences(tmp_path, seed)) == []
