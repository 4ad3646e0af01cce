"""Stages made from a seed, with all arcs, for the comparison of composed stages."""

import os
import random

from pxr import Gf, Sdf, Ts, Vt

NAMES = ("A", "B", "C", "D", "E")
TYPES = ("Xform", "Mesh", "Scope", "Camera", "SphereLight", "Unheard")
KINDS = ("component", "group", "assembly", "subcomponent", "model", "unheard")
SCHEMAS = ("CollectionAPI:lights", "MaterialBindingAPI", "UnheardAPI", "CollectionAPI", "SkelBindingAPI", "GeomModelAPI")
VALUES = {
    "a:float": (Sdf.ValueTypeNames.Float, lambda r: r.choice((0.5, 1.25, -3.0, 1e10))),
    "a:double": (Sdf.ValueTypeNames.Double, lambda r: r.random()),
    "a:half": (Sdf.ValueTypeNames.Half, lambda r: r.choice((0.5, 2.25))),
    "a:int": (Sdf.ValueTypeNames.Int, lambda r: r.randrange(-9, 9)),
    "a:bool": (Sdf.ValueTypeNames.Bool, lambda r: r.random() < 0.5),
    "a:string": (Sdf.ValueTypeNames.String, lambda r: r.choice(("", "text", "ä\n\"q\""))),
    "a:token": (Sdf.ValueTypeNames.Token, lambda r: r.choice(("x", "y"))),
    "a:asset": (Sdf.ValueTypeNames.Asset, lambda r: Sdf.AssetPath(r.choice(ASSETS))),
    "a:assets": (Sdf.ValueTypeNames.AssetArray, lambda r: Sdf.AssetPathArray([Sdf.AssetPath(a) for a in r.sample(ASSETS, 2)])),
    "a:time": (Sdf.ValueTypeNames.TimeCode, lambda r: Sdf.TimeCode(r.randrange(40) / 2)),
    "a:times": (Sdf.ValueTypeNames.TimeCodeArray, lambda r: Sdf.TimeCodeArray([Sdf.TimeCode(r.randrange(9)), Sdf.TimeCode(2.5)])),
    "a:vec": (Sdf.ValueTypeNames.Float3, lambda r: Gf.Vec3f(r.randrange(9), 0.5, -1)),
    "a:ints": (Sdf.ValueTypeNames.IntArray, lambda r: Vt.IntArray([r.randrange(9) for _ in range(r.choice((0, 2, 2, 3, 70)))])),
    "a:floats": (Sdf.ValueTypeNames.FloatArray, lambda r: Vt.FloatArray([r.randrange(9) / 4 for _ in range(r.choice((0, 2, 2, 3, 70)))])),
    "a:points": (Sdf.ValueTypeNames.Point3fArray, lambda r: Vt.Vec3fArray([Gf.Vec3f(r.random(), 1, 2) for _ in range(r.choice((1, 2, 2, 80)))])),
    "a:quat": (Sdf.ValueTypeNames.Quatf, lambda r: Gf.Quatf(r.random(), Gf.Vec3f(r.random(), 0.5, 0.25)).GetNormalized()),
    "a:matrix": (Sdf.ValueTypeNames.Matrix4d, lambda r: Gf.Matrix4d(r.randrange(1, 5))),
    "a:tokens": (Sdf.ValueTypeNames.TokenArray, lambda r: Vt.TokenArray([r.choice("xyz") for _ in range(r.choice((0, 2, 66)))])),
    "a:where": (Sdf.ValueTypeNames.PathExpression, lambda r: Sdf.PathExpression(r.choice(("/A//B", "/B/C + %_", "//C - /A/B", "/D{active}")))),
    "size": (Sdf.ValueTypeNames.Double, lambda r: r.random()),
    "radius": (Sdf.ValueTypeNames.Double, lambda r: 2.0),
    "points": (Sdf.ValueTypeNames.Point3fArray, lambda r: Vt.Vec3fArray([Gf.Vec3f(1, 2, 3)])),
    "xformOp:translate": (Sdf.ValueTypeNames.Double3, lambda r: Gf.Vec3d(1, r.randrange(9), 3)),
    "inputs:intensity": (Sdf.ValueTypeNames.Float, lambda r: r.random()),
}
ASSETS = ("./root.usda", "./asset1.usda", "gone.png", "", "`\"./${WHICH}.usda\"`", "/abs/gone.png", "`${UNSET}`")
RELATIONSHIPS = ("r:one", "r:two", "material:binding", "proxyPrim")


def variables(layer, which):
    """pxr.Usd 26.8 crashes if a layer stack gets the same variables from another layer (PcpLayerStack::Apply): no two layers have the same."""
    return {"WHICH": which, layer.GetDisplayName(): "set"}


def some_path(r, depth=3):
    return Sdf.Path("/" + "/".join(r.choice(NAMES) for _ in range(r.randint(1, depth))))


def list_op(r, kind, items):
    if r.random() < 0.3:
        return kind.CreateExplicit(items)
    op = kind()
    items = list(items)
    field = r.choice(("prependedItems", "appendedItems", "deletedItems"))
    setattr(op, field, items)
    return op


class Maker:
    def __init__(self, seed, folder):
        self.r = random.Random(seed)
        self.folder = folder
        self.layers = {}

    def layer(self, name):
        path = os.path.join(self.folder, name)
        layer = Sdf.Layer.CreateNew(path)
        self.layers[name] = layer
        return layer

    def chance(self, p):
        return self.r.random() < p

    def offset(self):
        if self.chance(0.7):
            return Sdf.LayerOffset()
        return Sdf.LayerOffset(self.r.choice((0, 5, -2.5)), self.r.choice((1, 2, 0.5)))

    def asset(self, layer):
        """One that does not lead back here: what is in a circle may have no end, for pxr.Usd neither."""
        if self.chance(0.03):
            return "./gone.usda"
        number = layer.GetDisplayName()[5:6] if layer.GetDisplayName().startswith("asset") else "-"
        names = [n for n in "012" if number == "-" or n > number]
        if number == "-" and self.chance(0.2):
            return "`\"./${WHICH}.usda\"`"
        return "./asset%s.usda" % self.r.choice(names) if names else ""

    def internal(self, spec):
        """A prim of the same layer, of a later name: arcs inside a layer make no circle either."""
        top = str(spec.path.StripAllVariantSelections()).split("/")[1]
        later = [name for name in NAMES if name > top] if top in NAMES else []
        if not later:
            return Sdf.Path()
        path = Sdf.Path("/" + self.r.choice(later))
        return path.AppendChild(self.r.choice(NAMES)) if self.chance(0.4) else path

    def reference(self, kind, spec):
        inside = self.internal(spec)
        if kind is Sdf.Reference and inside and self.chance(0.3):
            return kind("", inside, self.offset())
        asset = self.asset(spec.layer)
        target = some_path(self.r, 2) if self.chance(0.7) else Sdf.Path()
        return kind(asset, target, self.offset()) if asset else None

    def class_arc(self, spec):
        if "_class" in str(spec.path):
            return Sdf.Path()
        return Sdf.Path("/_class" + self.r.choice("XY")) if self.chance(0.7) else self.internal(spec)

    def arcs(self, spec):
        r = self.r
        if self.chance(0.25):
            for _ in range(r.randint(1, 2)):
                reference = self.reference(Sdf.Reference, spec)
                if reference:
                    spec.referenceList.Prepend(reference)
        if self.chance(0.1):
            payload = self.reference(Sdf.Payload, spec)
            if payload:
                spec.payloadList.Prepend(payload)
        for arcs, p in ((spec.inheritPathList, 0.15), (spec.specializesList, 0.1)):
            path = self.class_arc(spec) if self.chance(p) else Sdf.Path()
            if path:
                arcs.Prepend(path)

    def facts(self, spec):
        r = self.r
        if self.chance(0.3):
            spec.typeName = r.choice(TYPES)
        if self.chance(0.3):
            spec.kind = r.choice(KINDS)
        if self.chance(0.05):
            spec.active = r.random() < 0.3
        if self.chance(0.12):
            spec.instanceable = r.random() < 0.8
        if self.chance(0.15):
            spec.SetInfo("apiSchemas", list_op(r, Sdf.TokenListOp, r.sample(SCHEMAS, r.randint(1, 3))))
        if self.chance(0.15):
            spec.customData = {"n": r.randrange(9), "in": {r.choice("ab"): r.choice((1.5, "s", Sdf.AssetPath("./asset1.usda"),
                                                                                  Sdf.TimeCode(3), True))}}
        if self.chance(0.08):
            spec.documentation = r.choice(("one", "two"))
        if self.chance(0.06):
            spec.SetInfo("assetInfo", {"version": str(r.randrange(9)), "identifier": Sdf.AssetPath("./asset1.usda")})
        if self.chance(0.05):
            spec.SetInfo("inactiveIds", list_op(r, Sdf.Int64ListOp, [r.randrange(5), 7]))
        if self.chance(0.05):
            spec.hidden = True
        if self.chance(0.06):
            spec.propertyOrder = r.sample(sorted(VALUES), 3)
        if self.chance(0.05):
            spec.nameChildrenOrder = r.sample(NAMES, 3)

    def attribute(self, spec):
        r = self.r
        name = r.choice(sorted(VALUES))
        if name in spec.properties:
            return
        kind, make = VALUES[name]
        variability = Sdf.VariabilityUniform if self.chance(0.15) else Sdf.VariabilityVarying
        attr = Sdf.AttributeSpec(spec, name, kind, variability, declaresCustom=self.chance(0.3))
        if self.chance(0.6):
            attr.default = Sdf.ValueBlock() if self.chance(0.1) else make(r)
        if self.chance(0.35):
            for time in r.sample((-5, 0, 1, 2.5, 10, 24, 100), r.randint(1, 4)):
                spec.layer.SetTimeSample(attr.path, time, Sdf.ValueBlock() if self.chance(0.1) else make(r))
        elif name in ("a:double", "a:float", "size") and self.chance(0.3):
            spline = Ts.Spline("double" if name != "a:float" else "float")
            for time in r.sample((0, 3, 10, 20), 2):
                spline.SetKnot(Ts.Knot("double" if name != "a:float" else "float", time=time, value=r.random(),
                                       nextInterp=r.choice((Ts.InterpLinear, Ts.InterpHeld))))
            attr.SetInfo("spline", spline)
        if self.chance(0.15):
            attr.connectionPathList.Prepend(some_path(r).AppendProperty(r.choice(("a:float", "a:int"))))
        if self.chance(0.1):
            attr.SetInfo("customData", {"k": r.randrange(4), r.choice("pq"): "v"})
        if self.chance(0.06):
            attr.SetInfo("displayName", "Shown")
        if self.chance(0.05):
            attr.SetInfo("interpolation", "vertex")

    def relationship(self, spec):
        r = self.r
        name = r.choice(RELATIONSHIPS)
        if name in spec.properties:
            return
        rel = Sdf.RelationshipSpec(spec, name, custom=self.chance(0.3))
        targets = [some_path(r) if self.chance(0.7) else some_path(r).AppendProperty("a:int") for _ in range(r.randint(1, 2))]
        if self.chance(0.25):
            targets.append(spec.path.StripAllVariantSelections().AppendChild(r.choice(NAMES)))
        for target in dict.fromkeys(targets):
            if self.chance(0.2):
                rel.targetPathList.Append(target)
            elif self.chance(0.1):
                rel.targetPathList.deletedItems.append(target)
            else:
                rel.targetPathList.Prepend(target)
        if self.chance(0.1):
            rel.targetPathList.explicitItems = [targets[0]]

    def fill(self, spec, depth):
        r = self.r
        self.facts(spec)
        self.arcs(spec)
        for _ in range(r.choice((0, 0, 1, 2))):
            self.attribute(spec)
        if self.chance(0.15):
            self.relationship(spec)
        if depth > 0:
            for name in r.sample(NAMES, r.choice((0, 1, 1, 2, 3))):
                self.fill(Sdf.PrimSpec(spec, name, self.specifier()), depth - 1)
        if depth > 0 and self.chance(0.13):
            self.variants(spec, depth)

    def variants(self, spec, depth):
        r = self.r
        for set_name in r.sample(("look", "size"), r.randint(1, 2)):
            names = r.sample(("one", "two", "three"), r.randint(1, 3))
            variant_set = Sdf.VariantSetSpec(spec, set_name)
            spec.variantSetNameList.Prepend(set_name)
            for name in names:
                variant = Sdf.VariantSpec(variant_set, name)
                self.fill(variant.primSpec, depth - 1)
            if self.chance(0.8):
                spec.variantSelections[set_name] = r.choice(names + ["absent"])

    def specifier(self):
        return self.r.choice((Sdf.SpecifierDef,) * 5 + (Sdf.SpecifierOver,) * 3 + (Sdf.SpecifierClass,))

    def content(self, layer, prims):
        for name in self.r.sample(NAMES, min(prims, len(NAMES))):
            self.fill(Sdf.PrimSpec(layer, name, self.specifier()), 2)
        for name in ("_classX", "_classY"):
            if self.chance(0.6):
                self.fill(Sdf.PrimSpec(layer, name, Sdf.SpecifierClass), 1)
        if self.chance(0.7):
            layer.defaultPrim = self.r.choice(NAMES)

    def stage_facts(self, layer):
        r = self.r
        if self.chance(0.4):
            layer.expressionVariables = variables(layer, r.choice(("asset0", "asset1", "gone")))
        if self.chance(0.3):
            layer.startTimeCode, layer.endTimeCode = 1, 11
        if self.chance(0.3):
            layer.customLayerData = {"k" + r.choice("ab"): {"x": r.randrange(3)}}
        if self.chance(0.2):
            layer.timeCodesPerSecond = r.choice((24.0, 48.0, 30.0))
        if self.chance(0.2):
            layer.pseudoRoot.SetInfo("upAxis", "Z")
        if self.chance(0.1):
            layer.pseudoRoot.SetInfo("primOrder", r.sample(NAMES, 3))

    def sublayers(self, layer, names):
        for name in names:
            layer.subLayerPaths.append("./" + name)
        for i in range(len(names)):
            layer.subLayerOffsets[i] = self.offset()

    def relocates(self, layer):
        pairs = []
        for _ in range(self.r.randint(1, 2)):
            source = some_path(self.r, 3)
            if source.pathElementCount < 2:
                continue
            target = source.GetParentPath().AppendChild(self.r.choice(("Moved", "Other"))) if self.chance(0.8) else Sdf.Path()
            pairs.append((source, target))
        if pairs:
            layer.relocates = pairs

    def make(self):
        r = self.r
        assets = [self.layer("asset%d.usda" % i) for i in range(3)]
        subs = [self.layer("sub%d.usda" % i) for i in range(2)]
        root = self.layer("root.usda")
        self.content(root, r.randint(1, 4))
        self.stage_facts(root)
        for layer in subs:
            self.content(layer, r.randint(1, 2))
        for layer in assets:
            self.content(layer, r.randint(1, 2))
            if self.chance(0.3):
                layer.expressionVariables = variables(layer, r.choice(("asset1", "asset2")))
        self.sublayers(root, [n for n in ("sub0.usda", "sub1.usda") if self.chance(0.6)])
        if self.chance(0.3):
            self.sublayers(assets[0], ["sub1.usda"])
        if self.chance(0.05):
            subs[1].subLayerPaths.append("./" + r.choice(("root.usda", "gone.usda", "sub1.usda")))
        for layer in (root, assets[0]):
            if self.chance(0.25):
                self.relocates(layer)
        session = None
        if self.chance(0.4):
            session = self.layer("session.usda")
            self.content(session, 1)
            self.stage_facts(session)
        for layer in self.layers.values():
            layer.Save()
        return root.realPath, session.realPath if session else ""


def make(seed, folder):
    """Writes the layers of a stage into a folder; returns the files of its root and session layer."""
    os.makedirs(folder, exist_ok=True)
    return Maker(seed, folder).make()
