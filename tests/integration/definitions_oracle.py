"""Compares prim definitions of the C++ registry with those of pxr.Usd, in a process with a chosen plug-in
path.

usage: definitions_oracle.py PROBE OUTPUT SEED COUNT. Prints a line for each difference, then the number of
definitions. COUNT definitions are of random types with random API schemas; all schemas are always compared.
"""

import random
import subprocess
import sys

from pxr import Sdf, Tf, Usd

REGISTRY = Usd.SchemaRegistry()
KIND = Usd.SchemaKind


def schemas_of_kind(kind):
    base = Tf.Type.FindByName("UsdSchemaBase")
    infos = filter(None, map(REGISTRY.FindSchemaInfo, base.GetAllDerivedTypes()))
    return sorted(info.identifier for info in infos if info.kind == kind)


def requests(seed, count):
    """The requests: (type or "-", API schemas) for a prim; ("=NAME", []) for a schema itself."""
    concrete = schemas_of_kind(KIND.ConcreteTyped)
    single, multiple = schemas_of_kind(KIND.SingleApplyAPI), schemas_of_kind(KIND.MultipleApplyAPI)
    yield from ((name, []) for name in concrete)
    yield from (("-", [name]) for name in single)
    yield from (("-", [name + ":a:b"]) for name in multiple)
    yield from (("=" + name, []) for name in single + multiple + schemas_of_kind(KIND.AbstractTyped))
    choose = random.Random(seed)
    for _ in range(count):
        applied = [choose.choice(single) if choose.random() < 0.6 else
                   f"{choose.choice(multiple)}:{choose.choice(['a', 'b', 'c:d', 'prefix'])}"
                   for _ in range(choose.randint(1, 5))]
        if choose.random() < 0.1:
            applied.insert(0, choose.choice(["Unknown", multiple[0], single[0] + ":a"]))
        yield choose.choice([*concrete, "-", "Imageable", "Unknown"]), applied


def theirs(kind, applied):
    if kind.startswith("="):
        name = kind[1:]
        return REGISTRY.FindAppliedAPIPrimDefinition(name) or REGISTRY.FindAbstractPrimDefinition(name)
    if applied:
        # A prim gets nothing from an abstract type, but this function would accept one.
        return REGISTRY.BuildComposedPrimDefinition("" if kind in ("-", "Imageable") else kind, applied)
    return REGISTRY.FindConcretePrimDefinition(kind)


def said_of_prim(stage, path, kind, applied):
    """The names of properties and API schemas, in order, of a prim without opinions of its own."""
    prim = stage.DefinePrim(path, "" if kind == "-" else kind)
    if applied:
        prim.SetMetadata("apiSchemas", Sdf.TokenListOp.CreateExplicit(applied))
    return list(prim.GetPropertyNames()), list(prim.GetAppliedSchemas())


def plain(value):
    return str(value) if isinstance(value, Sdf.TokenListOp) else value


def said_by(definition):
    """Returns {(property or "", field): value} of a Usd.PrimDefinition."""
    fields = {("", field): plain(definition.GetMetadata(field)) for field in definition.ListMetadataFields()}
    for name in definition.GetPropertyNames():
        for field in definition.ListPropertyMetadataFields(name):
            fields[name, field] = plain(definition.GetPropertyMetadata(name, field))
    fields["", "apiSchemas"] = list(definition.GetAppliedAPISchemas())
    fields["", "names"] = sorted(definition.GetPropertyNames())
    fields.pop(("", "documentation"), None)
    return fields


def written_in(prim):
    """Returns the same for the definition that the probe wrote."""
    fields = {("", field): plain(prim.GetInfo(field)) for field in prim.ListInfoKeys()}
    for spec in prim.properties:
        for field in spec.ListInfoKeys():
            fields[spec.name, field] = plain(spec.GetInfo(field))
    fields["", "apiSchemas"] = list(prim.GetInfo("apiSchemas").explicitItems)
    fields["", "names"] = sorted(spec.name for spec in prim.properties)
    for field in ("specifier", "documentation"):
        fields.pop(("", field), None)
    return fields


def without_defaults(fields):
    """Removes values that a spec cannot distinguish from absent ones."""
    return {key: value for key, value in fields.items()
            if not (key[1] == "custom" and value is False)
            and not (key[1] == "variability" and value == Sdf.VariabilityVarying)}


def main(probe, output, seed, count):
    asked = list(requests(int(seed), int(count)))
    lines = "".join(" ".join([kind, *applied]) + "\n" for kind, applied in asked)
    subprocess.run([probe, "definitions", output], input=lines, text=True, check=True, stdout=subprocess.DEVNULL)
    layer = Sdf.Layer.FindOrOpen(output)
    stage = Usd.Stage.CreateInMemory()
    for number, (kind, applied) in enumerate(asked):
        prim = layer.GetPrimAtPath(f"/_{number}")
        if not kind.startswith("="):
            names = [spec.name for spec in prim.properties], list(prim.GetInfo("apiSchemas").explicitItems)
            if names != said_of_prim(stage, prim.path, kind, applied):
                print(kind, applied, "has", names, "and should have", said_of_prim(stage, prim.path, kind, applied))
        expected = without_defaults(said_by(theirs(kind, applied)))
        found = without_defaults(written_in(prim))
        for key in sorted(expected.keys() | found.keys()):
            if expected.get(key) != found.get(key):
                print(kind, applied, key, "is", found.get(key), "and should be", expected.get(key))
    print(len(asked), "definitions")


if __name__ == "__main__":
    main(*sys.argv[1:])
