"""Runs scripts with the Python classes of the schemas in tests/schemaKinds, and with pxr.Usd alone, in a process that has
these schemas from its start.

usage: schema_kinds.py MODULE script SEED PXR PYTHON: runs a random script on the layers PXR and PYTHON, and prints each line
with what it gives. schema_kinds.py MODULE types: writes and reads an attribute of every type.
"""

import inspect
import random
import runpy
import sys

from pxr import Sdf, Tf, Usd

# The class, and the schema's identifier and its property `number`.
CLASSES = {
    "KindsFreeAPI": ("KindsFreeAPI", "kinds:free:number"), "KindsFreerAPI": ("KindsFreerAPI", "kinds:free:number"),
    "KindsCardAPI": ("KindsCardAPI", "kinds:card:number"), "KindsLamp": ("KindsLamp", "kinds:thing:number"),
    "KindsThing": ("KindsThing", "kinds:thing:number"), "KindsRoom": ("KindsRoom", "kinds:room:number"),
    "KindsDimAPI": ("KindsDimAPI", "kinds:dim:number"), "KindsPlainAPI": ("KindsPlainAPI", "kinds:plain:number"),
    "PlugAPI": ("KindsPlugAPI", "kinds:plug:a:number"), "KindsMarkAPI": ("KindsMarkAPI", None),
    "KindsTypesAPI": ("KindsTypesAPI", None)}
KIND = Usd.SchemaKind
VERBS = ["valid", "add", "remove", "set", "get", "text", "link", "opaque"]


class Reference:
    """Runs a line of a script with pxr.Usd alone."""

    def __init__(self, stage):
        self.stage = stage

    def run(self, verb, name, path):
        self.identifier, self.number = CLASSES[name]
        self.prim = self.stage.GetPrimAtPath(path)
        self.kind = Usd.SchemaRegistry().FindSchemaInfo(self.identifier).kind
        self.instance = ["a"] if self.kind == KIND.MultipleApplyAPI else []
        self.is_api = self.kind in (KIND.SingleApplyAPI, KIND.MultipleApplyAPI)
        return getattr(self, verb)()

    def valid(self):
        if self.kind == KIND.NonAppliedAPI:
            found = bool(Usd.ModelAPI(self.prim))  # also one
        elif self.is_api:
            found = bool(self.prim) and self.prim.HasAPI(self.identifier, *self.instance)
        else:
            found = bool(self.prim) and self.prim.IsA(self.identifier)
        return str(found).lower()

    def add(self):
        if self.kind == KIND.ConcreteTyped:
            return "done" if self.stage.DefinePrim(self.prim.GetPath(), self.identifier) else "refused"
        if not self.is_api:
            return "impossible"
        return "done" if self.prim.ApplyAPI(self.identifier, *self.instance) else "refused"

    def remove(self):
        return "impossible" if not self.is_api else \
            "done" if self.prim.RemoveAPI(self.identifier, *self.instance) else "refused"

    def set(self):
        return self.write(self.number, Sdf.ValueTypeNames.Float, 7) if self.number else "impossible"

    def get(self):
        if not self.number:
            return "impossible"
        value = self.prim.GetAttribute(self.number).Get() if self.prim.HasAttribute(self.number) else None
        return str(value if value is None else int(value))

    def text(self):
        written = {"KindsPlugAPI": ("kinds:plug:a", "String", "on"), "KindsFreeAPI": ("kinds:free:mode", "Token", "slow"),
                   "KindsFreerAPI": ("kinds:freer:text", "String", "new")}.get(self.identifier)
        return self.write(written[0], getattr(Sdf.ValueTypeNames, written[1]), written[2]) if written else "impossible"

    def link(self):
        if self.identifier not in ("KindsFreeAPI", "KindsFreerAPI"):
            return "impossible"
        return "done" if self.prim.CreateRelationship("kinds:free:links", False).SetTargets([self.prim.GetPath()]) else "refused"

    def opaque(self):
        if self.identifier != "KindsTypesAPI":
            return "impossible"
        try:
            return "done" if self.prim.GetAttribute("kinds:types:groupValue").Set(Sdf.OpaqueValue()) else "refused"
        except Tf.ErrorException:
            return "refused"

    def write(self, name, kind, value):
        if self.kind == KIND.NonAppliedAPI:
            uniform = name == "kinds:free:mode"
            self.prim.CreateAttribute(name, kind, False, Sdf.VariabilityUniform if uniform else Sdf.VariabilityVarying)
        return "done" if self.prim.GetAttribute(name).Set(value) else "refused"


class Generated:
    """Runs a line of a script with the classes of Python."""

    def __init__(self, stage, classes):
        self.stage, self.classes = stage, classes

    def run(self, verb, name, path):
        kind, prim = self.classes[name], self.stage.GetPrimAtPath(path)
        instance = ["a"] if "instance" in inspect.signature(kind).parameters else []
        schema = kind(prim, *instance)
        if verb == "valid":
            return str(bool(schema)).lower()
        if verb == "add":
            if hasattr(kind, "apply"):
                return "done" if kind.apply(prim, *instance) else "refused"
            try:
                return "done" if kind.define(self.stage, path) else "refused"
            except (AttributeError, TypeError):
                return "impossible"
        if verb == "remove" and hasattr(schema, "remove"):
            schema.remove()
            return "done"
        if verb == "get" and hasattr(kind, "number"):
            return str(schema.number if schema.number is None else int(schema.number))
        if verb == "opaque" and hasattr(kind, "group_value"):
            try:
                schema.group_value = Sdf.OpaqueValue()
                return "done"
            except Tf.ErrorException:
                return "refused"
        texts = {"plug": "on", "text": "new", "mode": "slow"}
        for member, value in {"set": {"number": 7}, "text": texts, "link": {"links": path}}.get(verb, {}).items():
            if hasattr(kind, member):
                setattr(schema, member, value)
                return "done"
        return "impossible"


def script(seed, stage):
    """Chooses lines, and runs them with pxr.Usd, which says what can be written next: a property of a type or an applied
    schema only on a prim that has it."""
    choose, reference = random.Random(seed), Reference(stage)
    for _ in range(120):
        line = choose.choice(VERBS), choose.choice(list(CLASSES)), choose.choice(["/A", "/B", "/C", "/D"])
        if line[0] in ("set", "get", "text", "opaque") and reference.run("valid", *line[1:]) != "true":
            continue
        yield line, reference.run(*line)
    for name in CLASSES:
        for path in ("/A", "/B", "/C", "/D", "/None"):
            yield ("valid", name, path), reference.run("valid", name, path)


def run_script(kinds, seed, *files):
    stages = [Usd.Stage.Open(file) for file in files]
    generated = Generated(stages[1], kinds)
    for line, wanted in script(int(seed), stages[0]):
        found = generated.run(*line)
        assert found == wanted, (line, found, wanted)
        print(*line, wanted)
    for stage in stages:
        stage.GetRootLayer().Save()


def write_types(kinds):
    found = {Usd.SchemaRegistry().FindSchemaInfo(identifier).kind for identifier, _ in CLASSES.values()}
    assert found == {KIND.ConcreteTyped, KIND.AbstractTyped, KIND.NonAppliedAPI, KIND.SingleApplyAPI, KIND.MultipleApplyAPI}
    stage = Usd.Stage.CreateInMemory()
    schema = kinds["KindsTypesAPI"].apply(stage.DefinePrim("/A"))
    for name in schema.prim.GetPropertyNames():
        member = next(one for one in vars(type(schema)).values() if getattr(one, "name", None) == name)
        default = schema.prim.GetAttribute(name).GetTypeName().defaultValue
        if not isinstance(default, Sdf.OpaqueValue):
            member.__set__(schema, default)
            assert member.__get__(schema) == default, name
    print(len(schema.prim.GetAuthoredAttributes()))


if __name__ == "__main__":
    {"script": run_script, "types": write_types}[sys.argv[2]](runpy.run_path(sys.argv[1]), *sys.argv[3:])
