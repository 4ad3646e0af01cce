"""Computes a layer from its history with plain pxr.Sdf and the rules of PROTOCOL.md (ED1-ED6, V1-V10): an
oracle that shares no code with the product. It leaves out splines, array edits and unregistered values, which
Python cannot build from bytes."""

from __future__ import annotations

import math
import re
import struct

from pxr import Gf, Sdf, Tf, Vt

# Number: (struct format of an element, count, function from the numbers to the value, its array)
NUMBERS = {
    1: ("?", 1, Vt.Bool, Vt.BoolArray), 2: ("B", 1, Vt.UChar, Vt.UCharArray),
    3: ("i", 1, Vt.Int, Vt.IntArray), 4: ("I", 1, Vt.UInt, Vt.UIntArray),
    5: ("q", 1, Vt.Int64, Vt.Int64Array), 6: ("Q", 1, Vt.UInt64, Vt.UInt64Array),
    7: ("e", 1, Vt.Half, Vt.HalfArray), 8: ("f", 1, Vt.Float, Vt.FloatArray),
    9: ("d", 1, Vt.Double, Vt.DoubleArray), 10: ("d", 1, Sdf.TimeCode, Sdf.TimeCodeArray),
    20: ("d", 4, Gf.Matrix2d, Vt.Matrix2dArray), 21: ("d", 9, Gf.Matrix3d, Vt.Matrix3dArray),
    22: ("d", 16, Gf.Matrix4d, Vt.Matrix4dArray), 23: ("e", 4, Gf.Quath, Vt.QuathArray),
    24: ("f", 4, Gf.Quatf, Vt.QuatfArray), 25: ("d", 4, Gf.Quatd, Vt.QuatdArray),
    26: ("i", 2, Gf.Vec2i, Vt.Vec2iArray), 27: ("e", 2, Gf.Vec2h, Vt.Vec2hArray),
    28: ("f", 2, Gf.Vec2f, Vt.Vec2fArray), 29: ("d", 2, Gf.Vec2d, Vt.Vec2dArray),
    30: ("i", 3, Gf.Vec3i, Vt.Vec3iArray), 31: ("e", 3, Gf.Vec3h, Vt.Vec3hArray),
    32: ("f", 3, Gf.Vec3f, Vt.Vec3fArray), 33: ("d", 3, Gf.Vec3d, Vt.Vec3dArray),
    34: ("i", 4, Gf.Vec4i, Vt.Vec4iArray), 35: ("e", 4, Gf.Vec4h, Vt.Vec4hArray),
    36: ("f", 4, Gf.Vec4f, Vt.Vec4fArray), 37: ("d", 4, Gf.Vec4d, Vt.Vec4dArray),
}
TEXTS = {11: (str, Vt.StringArray), 12: (Vt.Token, Vt.TokenArray),
         13: (Sdf.AssetPath, Sdf.AssetPathArray),
         14: (Sdf.PathExpression, Sdf.PathExpressionArray), 15: (Sdf.Path, None)}
SPECIFIERS = (Sdf.SpecifierDef, Sdf.SpecifierOver, Sdf.SpecifierClass)
LISTS = ("explicit", "added", "prepended", "appended", "deleted", "ordered")
LIST_OPS = {3: Sdf.IntListOp, 4: Sdf.UIntListOp, 5: Sdf.Int64ListOp, 6: Sdf.UInt64ListOp,
            11: Sdf.StringListOp, 12: Sdf.TokenListOp, 15: Sdf.PathListOp,
            58: Sdf.ReferenceListOp, 59: Sdf.PayloadListOp}
ARRAY, SUBLAYER = 0x100, 60


class Typed:
    """A number or token: the Python value, and the exact type for fields where Sdf accepts any."""

    def __init__(self, plain, make):
        self.plain, self.typed = plain, make(plain)

    def __eq__(self, other):
        return isinstance(other, Typed) and self.plain == other.plain

    def __hash__(self):
        return hash(self.plain)


def plain(value):
    return value.plain if isinstance(value, Typed) else value


def typed(value):
    if type(value) is dict:
        return {key: typed(inner) for key, inner in value.items()}
    return value.typed if isinstance(value, Typed) else value


class Bytes:
    def __init__(self, content):
        self.content, self.at = content, 0

    def take(self, size):
        self.at += size
        assert self.at <= len(self.content)
        return self.content[self.at - size:self.at]

    def number(self, form):
        return struct.unpack("<" + form, self.take(struct.calcsize("<" + form)))[0]

    def text(self):
        return self.take(self.number("I")).decode()

    def done(self):
        return self.at == len(self.content)


class ListOp:
    def __init__(self, kind):
        self.kind, self.explicit = kind, False
        self.lists = {name: [] for name in LISTS}  # encoded leafs

    def empty(self):
        return not self.explicit and not any(self.lists.values())


class Samples(dict):
    pass


class Map(dict):
    pass


def _scalar(kind, bytes_):
    form, count, make, _ = NUMBERS[kind]
    values = struct.unpack(f"<{count}{form}", bytes_.take(struct.calcsize(f"<{count}{form}")))
    if kind in (23, 24, 25):
        return make(values[3], *values[:3])
    if kind < 10:
        return Typed(values[0], make)
    return make(*values)


def _arc(make, bytes_):
    asset, prim = bytes_.text(), bytes_.text()
    return make, (asset, prim, Sdf.LayerOffset(bytes_.number("d"), bytes_.number("d")))


def _leaf(kind, bytes_):
    if kind in NUMBERS:
        return _scalar(kind, bytes_)
    if kind in TEXTS:
        text = bytes_.text()
        return Typed(text, Vt.Token) if kind == 12 else TEXTS[kind][0](text)
    if kind & ARRAY:
        base, count = kind - ARRAY, bytes_.number("Q")
        if base in TEXTS:
            make = str if base == 12 else TEXTS[base][0]
            return TEXTS[base][1]([make(bytes_.text()) for _ in range(count)])
        return NUMBERS[base][3]([plain(_scalar(base, bytes_)) for _ in range(count)])
    if kind == 16:
        return Sdf.OpaqueValue()
    if kind == 50:
        return Sdf.ValueBlock()
    if kind == 51:
        return Sdf.AnimationBlock()
    if kind == 53:
        return SPECIFIERS[bytes_.number("B")]
    if kind == 54:
        return (Sdf.VariabilityVarying, Sdf.VariabilityUniform)[bytes_.number("B")]
    if kind == 55:
        return (Sdf.PermissionPublic, Sdf.PermissionPrivate)[bytes_.number("B")]
    if kind in (56, 57):
        return [bytes_.text() for _ in range(bytes_.number("I"))]
    if kind == 58:
        make, arguments = _arc(Sdf.Reference, bytes_)
        return make(*arguments, typed(_dictionary(bytes_)))
    if kind == 59:
        make, arguments = _arc(Sdf.Payload, bytes_)
        return make(*arguments)
    if kind == SUBLAYER:
        return bytes_.text(), Sdf.LayerOffset(bytes_.number("d"), bytes_.number("d"))
    raise NotImplementedError(f"a value of type {kind}")


def _dictionary(bytes_):
    return {bytes_.text(): content(bytes_) for _ in range(bytes_.number("I"))}


def _encoded_leaf(bytes_):
    begin = bytes_.at
    bytes_.number("H"), bytes_.number("B")
    bytes_.take(bytes_.number("Q"))
    return bytes_.content[begin:bytes_.at]


def content(bytes_):
    """V10: header and content."""
    kind, form, size = bytes_.number("H"), bytes_.number("B"), bytes_.number("Q")
    assert form == 0, "blobs are not for the oracle"
    inner = Bytes(bytes_.take(size))
    value = _composite(kind, inner) if 80 <= kind <= 83 else _leaf(kind, inner)
    assert inner.done(), f"bytes are left of a value of type {kind}"
    return value


def _composite(kind, bytes_):
    if kind == 80:
        return _dictionary(bytes_)
    if kind == 81:
        return Samples((bytes_.number("d"), content(bytes_)) for _ in range(bytes_.number("Q")))
    if kind == 82:
        op = ListOp(bytes_.number("H"))
        op.explicit = bool(bytes_.number("B"))
        for name in LISTS:
            op.lists[name] = [_encoded_leaf(bytes_) for _ in range(bytes_.number("I"))]
        return op
    bytes_.number("H")
    return Map((content(bytes_), content(bytes_)) for _ in range(bytes_.number("I")))


def value_of(encoded):
    return content(Bytes(encoded))


def item_key(encoded):
    """A list item is identified by its type and bytes, a sublayer by its asset path."""
    kind = struct.unpack_from("<H", encoded)[0]
    return value_of(encoded)[0] if kind == SUBLAYER else encoded


# --- paths (PA1) -------------------------------------------------------------------------------------

PRIM, ATTRIBUTE, ROOT, RELATIONSHIP, VARIANT, VARIANT_SET = 6, 1, 7, 8, 10, 11


def split(path):
    """Returns (parent, kind of child, name)."""
    if match := re.fullmatch(r"(.*)\{([^{}=]+)=([^{}]*)\}", path):
        owner, variant_set, variant = match.groups()
        return (f"{owner}{{{variant_set}=}}", VARIANT, variant) if variant else (
            owner, VARIANT_SET, variant_set)
    if match := re.fullmatch(r"(.*?)\.([^/{}]+)", path):
        return match[1], ATTRIBUTE, match[2]
    parent, name = re.fullmatch(r"(.*[/}])([^/}]+)", path).groups()
    return (parent if parent in "/" or parent[-1] == "}" else parent[:-1]), PRIM, name


def child(parent, kind, name):
    if kind == ATTRIBUTE:
        return f"{parent}.{name}"
    return parent + name if parent[-1] in "/}" else f"{parent}/{name}"


class Replay:
    """A layer to which commits are applied one after the other."""

    def __init__(self, name, text):
        self.name = name
        self.layer = Sdf.Layer.CreateAnonymous(".usda")
        assert self.layer.ImportFromString(text)
        # Fields in their wire form: Python would make one number type of many. Fields of the initial text are
        # not here; it should contain only fields that are later written as a whole.
        self.fields: dict[str, dict] = {}

    def apply(self, commit):
        edits = [e for e in commit["edits"] if commit["layers"][e["layer"]] == self.name]
        for index, edit in enumerate(edits):
            assert edit["sequence"] == 0, "addresses of a commit are paths"
            kind, action = edit["action"]
            getattr(self, kind)(edit["path"], action, edits[index:])

    # -- namespace

    def spec(self, path):
        found = self.layer.pseudoRoot if path == "/" else self.layer.GetObjectAtPath(path)
        assert found, f"no spec at {path}"
        return found

    def CreateSpec(self, path, action, following):
        if self.layer.GetObjectAtPath(path):
            return  # M2
        parent, _, name = split(path)
        kind = action["kind"]
        if kind == PRIM:
            Sdf.JustCreatePrimInLayer(self.layer, path)
        elif kind == ATTRIBUTE:
            # Sdf requires the type at creation.
            types = [value_of(e["action"][1]["value"]) for e in following if e["path"] == path
                     and e["action"][0] == "SetField" and e["action"][1]["field"] == "typeName"]
            type_name = Sdf.ValueTypeNames.Find(plain(types[0])) if types \
                else Sdf.ValueTypeNames.Token
            Sdf.JustCreatePrimAttributeInLayer(self.layer, path, type_name)
        elif kind == RELATIONSHIP:
            Sdf.JustCreateRelationshipInLayer(self.layer, path)
        elif kind == VARIANT_SET:
            Sdf.VariantSetSpec(self.spec(parent), name)
        else:
            Sdf.VariantSpec(self.spec(parent), name)

    def DeleteSpec(self, path, _action, _following):
        parent, kind, name = split(path)
        if kind == VARIANT:
            self.spec(parent).RemoveVariant(self.spec(parent).variants[name])
        elif kind == VARIANT_SET:
            del self.spec(parent).variantSets[name]
        else:
            self._namespace(Sdf.NamespaceEdit.Remove(path))
        for below in self._below(path):
            del self.fields[below]

    def MoveSpec(self, path, action, _following):
        parent, kind, _ = split(path)
        to = child(action["parent"]["path"], kind, action["name"])
        if to == path:
            return
        same = parent == action["parent"]["path"]
        self._namespace(Sdf.NamespaceEdit(
            path, to, Sdf.NamespaceEdit.same if same else Sdf.NamespaceEdit.atEnd))
        for below in self._below(path):
            self.fields[to + below[len(path):]] = self.fields.pop(below)

    def PlaceSpec(self, path, action, _following):
        parent, kind, _ = split(path)
        owner, before = self.spec(parent), action["before"]
        view = lambda: list((owner.nameChildren if kind == PRIM else owner.properties).keys())
        names, name = view(), split(path)[2]
        index = names.index(before) if before in names else len(names)
        expected = [n for n in names if n != name]
        expected.insert(expected.index(before) if before in expected else len(expected), name)
        if name == before or names == expected:  # before itself: it stays
            return
        # Sdf cannot move a spec among its siblings unless its name changes.
        aside = child(parent, kind, name + "_aside")
        self._namespace(Sdf.NamespaceEdit(path, aside, index))
        self._namespace(Sdf.NamespaceEdit(aside, path, Sdf.NamespaceEdit.same))
        assert view() == expected

    def _namespace(self, edit):
        batch = Sdf.BatchNamespaceEdit()
        batch.Add(edit)
        assert self.layer.Apply(batch), edit

    def _below(self, path):
        return [p for p in self.fields if p == path or (p.startswith(path) and p[len(path)] in "/.{")
                or (path[-1] == "}" and p.startswith(path[:-1] if path.endswith("=}") else path))]

    # -- fields

    def SetField(self, path, action, _following):
        fields = self.fields.setdefault(path, {})
        name, part = action["field"], action["part"]
        old = fields.get(name)
        if part is None:
            fields[name] = value_of(action["value"])
        elif part[0] == "SampleTime":
            fields[name] = old if isinstance(old, Samples) else Samples()
            fields[name][part[1]["time"]] = value_of(action["value"])
        elif part[0] == "DictionaryKey":
            fields[name] = inner = old if type(old) is dict else {}
            *outer, last = part[1]["path"]
            for key in outer:
                if type(inner.get(key)) is not dict:
                    inner[key] = {}
                inner = inner[key]
            inner[last] = value_of(action["value"])
        elif part[0] == "MapKey":
            fields[name] = old if isinstance(old, Map) else Map()
            fields[name][value_of(part[1]["key"])] = value_of(action["value"])
        else:
            fields[name] = op = old if isinstance(old, ListOp) else ListOp(action["form"])
            self._put(op, part[1])
        self._write(path, name, fields[name])

    def _put(self, op, part):
        chosen = LISTS[part["list"]]
        op.explicit = chosen == "explicit"
        for name in LISTS:
            if (name == "explicit") != op.explicit:
                op.lists[name] = []
        items = [i for i in op.lists[chosen] if item_key(i) != item_key(part["item"])]
        keys = [item_key(i) for i in items]
        before = part["before"] and item_key(part["before"])
        items.insert(keys.index(before) if before in keys else len(items), part["item"])
        op.lists[chosen] = items

    def EraseField(self, path, action, _following):
        fields = self.fields.setdefault(path, {})
        name, part = action["field"], action["part"]
        value = fields.get(name)
        if part is None:
            fields.pop(name, None)
        elif part[0] == "SampleTime" and isinstance(value, Samples):
            value.pop(part[1]["time"], None)
        elif part[0] == "DictionaryKey" and type(value) is dict:
            self._erase_key(value, part[1]["path"])
        elif part[0] == "MapKey" and isinstance(value, Map):
            value.pop(value_of(part[1]["key"]), None)
        elif part[0] == "ListItem" and isinstance(value, ListOp):
            chosen = LISTS[part[1]["list"]]
            value.lists[chosen] = [i for i in value.lists[chosen]
                                   if item_key(i) != item_key(part[1]["item"])]
        gone = value.empty() if isinstance(value, ListOp) else not value and isinstance(value, dict)
        if part is not None and gone:
            fields.pop(name, None)
        self._write(path, name, fields.get(name))

    def _erase_key(self, dictionary, path):
        key, *more = path
        if more and type(dictionary.get(key)) is dict:
            self._erase_key(dictionary[key], more)
            if dictionary[key]:
                return
        elif more:
            return
        dictionary.pop(key, None)

    # -- into the layer

    def _write(self, path, name, value):
        spec = self.spec(path)
        if name == "timeSamples":
            for time in self.layer.ListTimeSamplesForPath(path):
                if value is None or time not in value:
                    self.layer.EraseTimeSample(path, time)
            self._write_samples(path, value or {})
        elif name == "subLayers":
            layers = [value_of(item) for item in value.lists["explicit"]] if value else []
            self.layer.subLayerPaths = [asset for asset, _ in layers]
            for index, (_, offset) in enumerate(layers):
                self.layer.subLayerOffsets[index] = offset
        elif name in ("targetPaths", "connectionPaths"):
            proxy = spec.targetPathList if name == "targetPaths" else spec.connectionPathList
            proxy.ClearEdits()
            if value:
                self._fill(proxy, value)
        elif value is None:
            spec.ClearInfo(name)
        elif isinstance(value, ListOp):
            spec.SetInfo(name, self._list_op(value))
        elif isinstance(value, Map):
            pairs = [(plain(key), plain(to)) for key, to in value.items()]
            spec.SetInfo(name, pairs if name == "layerRelocates" else dict(pairs))
        elif isinstance(value, dict) or name == "default":
            spec.SetInfo(name, typed(value))
        else:
            spec.SetInfo(name, plain(value))
            if name == "typeName" and isinstance(spec, Sdf.AttributeSpec):
                self._write_samples(path, self.fields[path].get("timeSamples", {}))

    def _write_samples(self, path, samples):
        for time, sample in samples.items():
            assert math.isfinite(time)
            try:
                self.layer.SetTimeSample(path, time, typed(sample))
            except Tf.ErrorException:
                # Sdf requires samples of the attribute's type, which may come later: then the samples are
                # written again.
                assert self.fields[path].get("typeName") is None, path

    def _fill(self, proxy, op):
        if op.explicit:
            proxy.ClearEditsAndMakeExplicit()
        for name in LISTS:
            items = [value_of(i) for i in op.lists[name]]
            if items:
                getattr(proxy, f"{name}Items")[:] = items

    def _list_op(self, op):
        made = LIST_OPS[op.kind]()
        for name in LISTS:
            items = [plain(value_of(i)) for i in op.lists[name]]
            if items or (op.explicit and name == "explicit"):
                setattr(made, f"{name}Items", items)
        return made
