"""Random edits of a layer with plain Sdf, for any OpenUSD: `make(random, layer)` makes one, or none where Sdf refuses it."""

from pxr import Gf, Sdf, Tf, Vt

NAMES = ["A", "B", "C", "D"]
VALUES = {
    "float": lambda r: r.random(), "int": lambda r: r.randrange(100), "token": lambda r: r.choice(NAMES),
    "string[]": lambda r: [r.choice(NAMES) for _ in range(r.randrange(3))],
    "double3": lambda r: Gf.Vec3d(r.random(), 2, 3), "point3f[]": lambda r: [(r.random(), 0, 1)] * r.randrange(3),
    "quatf": lambda r: Gf.Quatf(r.random(), 0, 1, 0), "matrix4d": lambda r: Gf.Matrix4d(r.random()),
    "asset": lambda r: Sdf.AssetPath(f"./{r.choice(NAMES)}.png"), "half": lambda r: r.randrange(8) / 4,
    "uint64": lambda r: r.randrange(2 ** 60), "bool": lambda r: r.random() < 0.5,
}


def prims(layer):
    """All prim specs, also those of variants."""
    found = []

    def visit(prim):
        found.append(prim)
        for child in prim.nameChildren:
            visit(child)
        for variants in prim.variantSets:
            for variant in variants.variants:
                visit(variant.primSpec)

    for prim in layer.rootPrims:
        visit(prim)
    return found


def create(r, layer):
    parent = r.choice([layer, *prims(layer)])
    if isinstance(parent, Sdf.PrimSpec) and str(parent.path).count("/") > 4:
        return
    Sdf.PrimSpec(parent, r.choice(NAMES), r.choice([Sdf.SpecifierDef, Sdf.SpecifierOver, Sdf.SpecifierClass]),
                 r.choice(["", "Xform", "Cube"]))


def delete(r, layer):
    prim = r.choice(prims(layer))
    owner = prim.nameParent
    if prim.path.IsPrimVariantSelectionPath():
        return
    del (owner.nameChildren if owner else layer.rootPrims)[prim.name]


def move(r, layer):
    prim = r.choice(prims(layer))
    if prim.path.IsPrimVariantSelectionPath():
        return
    to = r.choice([prim.path.GetParentPath(), Sdf.Path.absoluteRootPath, r.choice(prims(layer)).path])
    edit = Sdf.BatchNamespaceEdit()
    edit.Add(prim.path, to.AppendChild(r.choice(NAMES)), r.choice([-1, 0, 1]))
    layer.Apply(edit)


def attribute(r, layer):
    prim, kind = r.choice(prims(layer)), r.choice(list(VALUES))
    name = f"x:{kind.replace('[]', 's')}"
    made = prim.properties.get(name) or Sdf.AttributeSpec(prim, name, Sdf.ValueTypeNames.Find(kind))
    what = r.randrange(5)
    if what == 0:
        made.SetInfo("default", Sdf.ValueBlock())
    elif what == 1:
        made.ClearInfo("default")
    else:
        made.default = VALUES[kind](r)
    if r.random() < 0.2:
        made.connectionPathList.prependedItems.append(f"/{r.choice(NAMES)}.x:float")


def samples(r, layer):
    prim = r.choice(prims(layer))
    made = prim.properties.get("x:double") or Sdf.AttributeSpec(prim, "x:double", Sdf.ValueTypeNames.Double)
    time = r.randrange(6) / 2
    if r.random() < 0.3:
        layer.EraseTimeSample(made.path, time)
    else:
        layer.SetTimeSample(made.path, time, r.random())


def relationship(r, layer):
    prim = r.choice(prims(layer))
    made = prim.properties.get("r") or Sdf.RelationshipSpec(prim, "r")
    items = getattr(made.targetPathList, r.choice(["prependedItems", "appendedItems", "deletedItems"]))
    target = Sdf.Path(f"/{r.choice(NAMES)}")
    if target in list(items):
        items.remove(target)
    else:
        items.insert(0, target)


def remove_property(r, layer):
    prim = r.choice([prim for prim in prims(layer) if prim.properties])
    prim.RemoveProperty(r.choice(list(prim.properties)))


def metadata(r, layer):
    prim = r.choice(prims(layer))
    field, value = r.choice([("kind", "group"), ("kind", "component"), ("documentation", str(r.random())), ("active", True),
                             ("hidden", r.random() < 0.5)])
    if r.random() < 0.2:
        prim.ClearInfo(field)
    else:
        prim.SetInfo(field, value)


def custom(r, layer):
    spec = r.choice([*prims(layer), None])
    value = r.choice([Vt.Float(r.random()), r.random(), r.randrange(9), "text", Vt.Token("t"), Vt.IntArray([1, r.randrange(9)]),
                      {"deep": Vt.Half(0.5)}])
    if spec is None:
        layer.customLayerData = {**layer.customLayerData, r.choice(NAMES): value}
    else:
        spec.customData[r.choice(NAMES)] = value


def reference(r, layer):
    prim = r.choice(prims(layer))
    items = prim.referenceList.prependedItems
    data = {"weight": Vt.Float(r.random())} if r.random() < 0.3 else {}
    items.insert(0, Sdf.Reference("", f"/{r.choice(NAMES)}", Sdf.LayerOffset(r.randrange(3)), data))


def variant(r, layer):
    prim = r.choice([prim for prim in prims(layer) if str(prim.path).count("{") < 2])
    sets = prim.variantSets.get("v") or Sdf.VariantSetSpec(prim, "v")
    name = r.choice(NAMES)
    if sets.variants.get(name):
        if r.random() < 0.3:
            sets.RemoveVariant(sets.variants[name])
    else:
        Sdf.VariantSpec(sets, name)
    prim.variantSelections["v"] = name


KINDS = [create, create, create, delete, move, move, attribute, attribute, attribute, samples, relationship, remove_property,
         metadata, custom, reference, variant]


def make(r, layer):
    try:
        r.choice(KINDS)(r, layer)
    except (IndexError, Tf.ErrorException):
        pass  # there is nothing to edit in this way, or Sdf refuses it
