"""Dumps the content that pxr.Usd shows of a stage, in the format "stage-dump/1": the reference for `usdlive dump --composed`.

As a program: `stage_dump.py LIST` writes one dump for each line ROOT, SESSION, BASE, OUT of the list (tabs between them), and
`stage_dump.py LIST FIRST LAST FOLDER` first makes the stages of these seeds and writes the list. Stages that pxr.Usd itself fails on
are left out of the list.
"""

import hashlib
import itertools
import json
import math
import os
import sys

import numpy
from pxr import Gf, Sdf, Tf, Usd

FOLD = 64
BIGGEST = 300  # prims of a stage that is made from a seed
SOURCES = ("None", "Fallback", "Default", "TimeSamples", "ValueClips", "Spline")
UNNAMED = {"2": "ArcToProhibitedChild"}  # an error type that pxr.Usd registers no name for
SKIPPED = {
    "prim": {"specifier", "typeName", "active", "kind", "instanceable"},
    "attribute": {"typeName", "variability", "custom", "default", "timeSamples", "connectionPaths", "spline"},
    "relationship": {"variability", "custom", "targetPaths"},
    "stage": {"subLayers", "subLayerOffsets", "primChildren"},
}


def plain(number):
    if isinstance(number, float) and not math.isfinite(number):
        return str(number)
    return number


def nested(items):
    return [nested(item) for item in items] if isinstance(items, (list, tuple)) else plain(items)


class Values:
    def __init__(self, base):
        self.base = os.path.realpath(base)

    def file(self, path):
        if not os.path.isabs(path):
            return path
        name, bracket, inside = path.partition("[")
        relative = os.path.relpath(os.path.realpath(name), self.base)
        return path if relative.startswith("..") else "$BASE/" + relative + bracket + inside

    def array(self, items):
        if len(items) and not isinstance(items[0], (str, Sdf.AssetPath, Sdf.Path, Sdf.TimeCode, Sdf.PathExpression)):
            numbers = numpy.array(items)
            if numbers.dtype != object:
                if len(items) <= FOLD:
                    return nested(numbers.tolist())
                raw = numpy.ascontiguousarray(numbers).tobytes()  # every machine of the tests is little-endian
                return {"n": len(items), "sha256": hashlib.sha256(raw).hexdigest()}
        shown = [self(item) for item in items]
        if len(shown) <= FOLD:
            return shown
        lines = "\n".join(item if isinstance(item, str) else json.dumps(item, sort_keys=True) for item in shown)
        return {"n": len(shown), "sha256": hashlib.sha256(lines.encode()).hexdigest()}

    def list_op(self, value):
        if value.isExplicit:
            return {"listOp": {"explicit": [self(item) for item in value.explicitItems]}}
        lists = {name: getattr(value, name + "Items") for name in ("added", "prepended", "appended", "deleted", "ordered")}
        return {"listOp": {name: [self(item) for item in items] for name, items in lists.items() if items}}

    def __call__(self, value):
        kind = type(value)
        if value is None or isinstance(value, (bool, str)):
            return value
        if isinstance(value, (int, float)):
            return plain(value)
        if isinstance(value, Sdf.ValueBlock):
            return {"block": True}
        if isinstance(value, Sdf.TimeCode):
            return plain(value.GetValue())
        if isinstance(value, Sdf.AssetPath):
            return {"asset": value.path, "resolved": self.file(value.resolvedPath)}
        if isinstance(value, Sdf.Path):
            return str(value)
        if isinstance(value, Sdf.PathExpression):
            return {"pathExpression": value.GetText()}
        if isinstance(value, Sdf.UnregisteredValue):
            return {"unregistered": self(value.value)}
        if isinstance(value, dict):
            return {"dict": {key: self(item) for key, item in value.items()}}
        if hasattr(value, "explicitItems"):
            return self.list_op(value)
        if isinstance(value, (Gf.Quath, Gf.Quatf, Gf.Quatd)):
            return [plain(float(part)) for part in (*value.imaginary, value.real)]
        if kind.__module__ == "pxr.Gf" and hasattr(value, "dimension"):
            if isinstance(value.dimension, int):
                return [plain(part) for part in value]
            rows, columns = value.dimension
            return [[plain(value[row][column]) for column in range(columns)] for row in range(rows)]
        if kind.__module__ == "pxr.Vt" or isinstance(value, (list, tuple)):
            return self.array(value)
        if isinstance(value, Tf.Enum):
            return value.displayName
        return {"type": kind.__name__, "text": str(value)}  # also the arrays that Sdf declares


class Dump:
    def __init__(self, stage, base):
        self.stage = stage
        self.values = Values(base)
        self.prototypes = {}
        self.times = [0.0, 1.25, 24.0]
        if stage.HasAuthoredTimeCodeRange():
            start, end = stage.GetStartTimeCode(), stage.GetEndTimeCode()
            self.times = [start, (start + end) / 2 + 0.25, end]

    def metadata(self, of, what):
        return {name: self.values(value) for name, value in of.GetAllAuthoredMetadata().items() if name not in SKIPPED[what]}

    def attribute(self, attribute):
        info = attribute.GetResolveInfo()
        source = next(name for name in SOURCES if info.GetSource() == getattr(Usd, "ResolveInfoSource" + name))
        record = {
            "kind": "attribute", "type": str(attribute.GetTypeName()), "custom": attribute.IsCustom(),
            "variability": "uniform" if attribute.GetVariability() == Sdf.VariabilityUniform else "varying",
            "authored": attribute.IsAuthored(), "source": source[0].lower() + source[1:], "blocked": info.ValueIsBlocked(),
            "default": self.values(attribute.Get()),
        }
        if attribute.GetNumTimeSamples():
            record["samples"] = self.values.array(attribute.GetTimeSamples())
        if attribute.HasSpline():
            record["spline"] = True
        if "samples" in record or "spline" in record or attribute.ValueMightBeTimeVarying():
            record["at"] = [self.values(attribute.Get(time)) for time in self.times]
        if attribute.GetConnections() or attribute.HasAuthoredConnections():
            record["connections"] = [str(path) for path in attribute.GetConnections()]
        return record

    def property(self, prop):
        if isinstance(prop, Usd.Attribute):
            record = self.attribute(prop)
        else:
            record = {"kind": "relationship", "custom": prop.IsCustom(), "authored": prop.IsAuthored(),
                      "targets": [str(path) for path in prop.GetTargets()]}
        metadata = self.metadata(prop, record["kind"])
        return {**record, "metadata": metadata} if metadata else record

    def prim(self, prim):
        record = {
            "path": str(prim.GetPath()), "specifier": prim.GetSpecifier().displayName.lower(), "type": str(prim.GetTypeName()),
            "active": prim.IsActive(), "loaded": prim.IsLoaded(), "defined": prim.IsDefined(), "abstract": prim.IsAbstract(),
            "model": prim.IsModel(), "group": prim.IsGroup(), "kind": prim.GetKind(),
            "schemas": [str(name) for name in prim.GetAppliedSchemas()],
            "children": [str(name) for name in prim.GetAllChildrenNames()],
            "metadata": self.metadata(prim, "prim"),
            "propertyOrder": [str(prop.GetName()) for prop in prim.GetProperties()],
            "properties": {str(prop.GetName()): self.property(prop) for prop in prim.GetProperties()},
        }
        if prim.HasAuthoredInstanceable():
            record["instanceable"] = prim.IsInstanceable()
        if prim.IsInstance():
            record["prototype"] = self.prototypes.setdefault(prim.GetPrototype().GetPath(), len(self.prototypes))
        if prim.IsInstanceProxy():
            record["proxy"] = True
        if prim.HasVariantSets():
            sets = prim.GetVariantSets()
            record["variants"] = {
                name: {"selection": sets.GetVariantSelection(name), "options": sets.GetVariantSet(name).GetVariantNames()}
                for name in sets.GetNames()}
        return record

    def all(self):
        root = self.stage.GetPseudoRoot()
        found = [(error.errorType.name.split("ErrorType_")[-1], error.rootSite.path) for error in self.stage.GetCompositionErrors()]
        errors = [{"type": UNNAMED.get(name, name), "prim": str(path)} for name, path in found]
        return {
            "format": "stage-dump/1", "times": self.times,
            "layers": [self.values.file(layer.realPath) or "anonymous" for layer in self.stage.GetLayerStack(True)],
            "metadata": self.metadata(root, "stage"),
            "rootChildren": [str(name) for name in root.GetAllChildrenNames()],
            "errors": sorted(errors, key=lambda error: (error["prim"], error["type"])),
            "prims": [self.prim(prim) for prim in everything(self.stage)],
        }


def everything(stage):
    prims = Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies(Usd.PrimAllPrimsPredicate))
    return itertools.islice(prims, 1, None)


def open_stage(root, session):
    layer = Sdf.Layer.FindOrOpen(root)
    return Usd.Stage.Open(layer, Sdf.Layer.FindOrOpen(session)) if session else Usd.Stage.Open(layer)


def differences(want, got, where=""):
    """Places in two dumps that are not alike; numbers may differ in the last digits."""
    if isinstance(want, dict) and isinstance(got, dict):
        for key in sorted(want.keys() | got.keys()):
            yield from differences(want.get(key, "(absent)"), got.get(key, "(absent)"), where + "/" + str(key))
    elif isinstance(want, list) and isinstance(got, list) and len(want) == len(got):
        for at, (one, other) in enumerate(zip(want, got)):
            name = one["path"] if isinstance(one, dict) and "path" in one else at
            yield from differences(one, other, "%s[%s]" % (where, name))
    elif isinstance(want, bool) or isinstance(got, bool) or not (isinstance(want, (int, float)) and isinstance(got, (int, float))):
        if want != got:
            yield "%s: pxr.Usd has %s, usdlive %s" % (where, json.dumps(want)[:200], json.dumps(got)[:200])
    elif not math.isclose(want, got, rel_tol=1e-6, abs_tol=1e-9):
        yield "%s: pxr.Usd has %r, usdlive %r" % (where, want, got)


def write(words):
    root, session, base, out = words
    stage = open_stage(root, session)
    if sum(1 for _ in itertools.islice(everything(stage), BIGGEST + 1)) > BIGGEST and "seed" in os.path.basename(base):
        return False
    with open(out, "w", encoding="utf-8") as stream:
        json.dump(Dump(stage, base).all(), stream)
    return True


def main():
    path, seeds = sys.argv[1], sys.argv[2:]
    if seeds:
        import stage_seeds

        first, last, folder = int(seeds[0]), int(seeds[1]), seeds[2]
        lines = []
        for seed in range(first, last):
            base = os.path.join(folder, "seed%d" % seed)
            root, session = stage_seeds.make(seed, base)
            lines.append((root, session, base, os.path.join(base, "want.json")))
    else:
        with open(path, encoding="utf-8") as stream:
            lines = [line.rstrip("\n").split("\t") for line in stream]
    with open(path, "w", encoding="utf-8") as stream:
        for words in lines:
            try:
                written = write(words)
            except Tf.ErrorException:
                continue  # Pcp's own checks fail on a few stages of the seeds
            if written:
                stream.write("\t".join(words) + "\n")
                stream.flush()


if __name__ == "__main__":
    main()
