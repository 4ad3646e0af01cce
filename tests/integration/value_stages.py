"""Random stages of three files, with attributes of all types, for the comparison of values."""

import random

from pxr import Sdf, Ts, Vt

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
        self.format = self.choose.choice(["usda", "usdc"])  # in memory, or read from disk when asked for

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
        root, sub, asset = (self.layer(f"{name}{self.number}.{self.format}") for name in ("root", "sub", "asset"))
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
