"""Reads the content of an Sdf.Layer for the session, and writes what the session tells into one."""

from __future__ import annotations

import functools
import re
import typing

from pxr import Sdf, Tf

from .. import _session
from . import values
from ._text_types import dictionary_types, reference_types
from .values import Unsupported

ATTRIBUTE, PRIM, ROOT, RELATIONSHIP, VARIANT, VARIANT_SET = 1, 6, 7, 8, 10, 11
_PATH_LISTS = {"targetPaths": "targetPathList", "connectionPaths": "connectionPathList"}
# The names in Tf of the types of fields whose values are plain in Python.
_TYPES = {"bool": 1, "unsigned char": 2, "int": 3, "unsigned int": 4, "long": 5, "unsigned long": 6, "int64_t": 5, "uint64_t": 6,
          "pxr_half::half": 7, "GfHalf": 7, "float": 8, "double": 9, "string": values.STRING, "TfToken": values.TOKEN,
          "vector<TfToken, allocator<TfToken> >": values.TOKENS, "vector<string, allocator<string> >": values.STRINGS}
# The fields that name other layers.
_ARCS = ("subLayers", "references", "payload")
_field_types: dict[tuple[type, str], str] = {}

Refuse = typing.Callable[[str, str, str], None]


# The fields that nearly each spec has, and whose values many specs have, with the types that Python does not tell.
_COMMON = {"specifier": None, "variability": None, "custom": None, "typeName": values.TOKEN}
_encoded = functools.lru_cache(4096, typed=True)(values.encode)
_value_type_of = functools.cache(_session.value_type_of)


def object_at(layer: Sdf.Layer, path: str) -> Sdf.Spec | None:
    """The spec at a path. Of a variant, the prim spec, which has its fields and children."""
    spec = layer.GetObjectAtPath(path)
    return spec.primSpec if isinstance(spec, Sdf.VariantSpec) else spec


def _type_of(spec: Sdf.Spec, field: str) -> str:
    key = (type(spec), field)
    if key not in _field_types:
        _field_types[key] = spec.GetTypeForInfo(field).typeName
    return _field_types[key]


def is_known(spec: Sdf.Spec, field: str) -> bool:
    """Whether this OpenUSD knows the field for such a spec."""
    return _type_of(spec, field) not in ("", "void") or field in ("default", "timeSamples", "displayUnit")


def child_names(spec: Sdf.Spec, field: str) -> list[str]:
    """The names of children, by the field that lists them. The lists that a spec has, such as `nameChildren`, cost ten
    times as much."""
    return spec.GetInfo(field)


def named_assets(data: bytes) -> set[str]:
    """The asset paths in an encoded field that names layers."""
    _, lists = values.decoded_list(data)
    return {item[0] if isinstance(item, tuple) else item.assetPath for items in lists for item in items}


def assets_of(fields: dict[str, bytes]) -> set[str]:
    """The asset paths of layers in these fields."""
    return set().union(*(named_assets(fields[field]) for field in _ARCS if field in fields))


class Memory:
    """The encoded bytes of fields whose types cost much to find, as long as the layer has the same value."""

    def __init__(self) -> None:
        self._known: dict[tuple[str, str], tuple[object, bytes]] = {}

    def note(self, path: str, field: str, value: object, data: bytes) -> None:
        self._known[path, field] = (value, data)

    def recall(self, path: str, field: str, value: object) -> bytes | None:
        known = self._known.get((path, field))
        return known[1] if known is not None and _equal(known[0], value) else None

    def clear(self) -> None:
        self._known.clear()


def _equal(left: object, right: object) -> bool:
    if type(left) is not type(right):
        return False
    if isinstance(left, dict):
        return left.keys() == right.keys() and all(_equal(left[key], right[key]) for key in left)  # type: ignore[attr-defined]
    return bool(left == right)


# --- reading

Spec = tuple[str, int, dict[str, bytes], list[str], list[str], list[str], list[str]]


class Reader:
    """Reads specs of a layer as Session.capture() takes them. `is_held(path)`: whether the session has the spec. Calls
    `refuse(path, field, why)` for what cannot be shared."""

    def __init__(self, layer: Sdf.Layer, memory: Memory, is_held: typing.Callable[[str], bool], refuse: Refuse):
        self._layer, self._memory, self._is_held, self._refuse = layer, memory, is_held, refuse
        self._exact = True
        self._specs: list[Spec] = []
        self._read: set[str] = set()
        self.assets: set[str] = set()  # the paths of layers that were read

    def all(self, exact: bool) -> list[Spec]:
        """Reads the whole layer. `exact`: also finds that only the type of an entry of a dictionary has changed, which takes
        as long as writing the specs with dictionaries as text."""
        self._exact = exact
        self._prim(self._layer.pseudoRoot, "/", ROOT, deep=True)
        return self._specs

    def at(self, paths: typing.Iterable[str], exact: bool) -> list[Spec]:
        """Reads the prims, variants or root at these paths with their properties, and what is new below them. For a path
        without a spec, or with a new one, its parent is read."""
        self._exact = exact
        for path in sorted(paths):
            spec = object_at(self._layer, path)
            while path != "/" and (not isinstance(spec, Sdf.PrimSpec) or not self._is_held(path)):
                path = _session.parent_of(path)
                spec = object_at(self._layer, path)
            if isinstance(spec, (Sdf.PrimSpec, Sdf.PseudoRootSpec)):
                self._prim(spec, path, ROOT if path == "/" else VARIANT if path.endswith("}") else PRIM, deep=False)
        return self._specs

    def _prim(self, prim: typing.Any, path: str, kind: int, deep: bool) -> None:
        if path in self._read:
            return
        self._read.add(path)
        children = child_names(prim, "primChildren")
        properties = () if kind == ROOT else child_names(prim, "properties")
        sets = () if kind == ROOT else child_names(prim, "variantSetChildren")
        self._add(prim, path, kind, children, properties, sets)
        below = "" if kind == ROOT else path
        for name in properties:
            at = f"{below}.{name}"
            one = self._layer.GetObjectAtPath(at)
            self._add(one, at, ATTRIBUTE if isinstance(one, Sdf.AttributeSpec) else RELATIONSHIP)
        separator = "" if kind == VARIANT else "/"
        for name in children:
            at = f"{below}{separator}{name}"
            if deep or not self._is_held(at):
                self._prim(self._layer.GetObjectAtPath(at), at, PRIM, deep=True)
        for name in sets:
            at = f"{below}{{{name}=}}"
            one = self._layer.GetObjectAtPath(at)
            variants = child_names(one, "variantChildren")
            self._add(one, at, VARIANT_SET, variants=variants)
            for variant in variants:
                at = f"{below}{{{name}={variant}}}"
                if deep or not self._is_held(at):
                    self._prim(object_at(self._layer, at), at, VARIANT, deep=True)

    def _add(self, spec: Sdf.Spec, path: str, kind: int, prims: typing.Sequence[str] = (), properties: typing.Sequence[str] = (),
             sets: typing.Sequence[str] = (), variants: typing.Sequence[str] = ()) -> None:
        fields: dict[str, bytes] = {}
        for field in spec.ListInfoKeys():
            if field == "subLayerOffsets":
                continue
            try:
                fields[field] = self._field(spec, path, field)
                if field in _ARCS:
                    self.assets |= named_assets(fields[field])
            except Unsupported as error:
                self._refuse(path, field, str(error))
            except (TypeError, Tf.ErrorException) as error:
                self._refuse(path, field, f"Python cannot read its value: {error}")
        self._specs.append((path, kind, fields, list(prims), list(properties), list(sets), list(variants)))

    def _field(self, spec: Sdf.Spec, path: str, field: str) -> bytes:
        if field == "subLayers":
            return values.encode_sublayers(zip(self._layer.subLayerPaths, self._layer.subLayerOffsets))
        value = spec.GetInfo(field)
        if field in _COMMON:
            return _encoded(value, _COMMON[field])
        if field in ("default", "timeSamples"):
            number = _value_type_of(str(spec.GetInfo("typeName")))
            if field == "timeSamples":
                return values.encode_samples(value, number)
            if isinstance(value, dict):
                raise Unsupported("an attribute cannot have a dictionary")
            return values.encode(value, number)
        if values.is_list_op(value):
            return self._list_op(spec, path, field, value)
        if field == "variantSelection":
            return values.encode_map(sorted(value.items()), values.STRING)
        if field in ("relocates", "layerRelocates"):
            return values.encode_map(value.items() if isinstance(value, dict) else value, values.PATH)
        if isinstance(value, dict):
            return self._dictionary(spec, path, field, value)
        if field == "displayUnit":
            return values.encode(Sdf.GetNameForUnit(value), values.TOKEN)
        if isinstance(value, list) and _type_of(spec, field) not in _TYPES:
            raise Unsupported(f"its type {_type_of(spec, field)} cannot be shared by this backend")
        return values.encode(value, _TYPES.get(_type_of(spec, field)))

    def _dictionary(self, spec: Sdf.Spec, path: str, field: str, value: dict) -> bytes:
        data = None if self._exact else self._memory.recall(path, field, value)
        if data is None:
            data = values.encode(value, types=dictionary_types(spec, field) if values.is_ambiguous(value) else None)
            self._memory.note(path, field, value, data)
        return data

    def _list_op(self, spec: Sdf.Spec, path: str, field: str, value: typing.Any) -> bytes:
        items = [item for name in values.LISTS for item in getattr(value, name)] if field == "references" else []
        if not any(item.customData for item in items):
            return values.encode_list_op(value)
        data = None if self._exact else self._memory.recall(path, field, value)
        if data is None:
            data = values.encode_list_op(value, reference_types(spec))
            self._memory.note(path, field, value, data)
        return data


# --- writing

class Writer:
    """Writes changes of the session into a layer. Content that this OpenUSD cannot express is left out."""

    def __init__(self, layer: Sdf.Layer, memory: Memory):
        self._layer, self._memory = layer, memory
        self._late: dict[str, dict[str, bytes | None]] = {}  # fields of attributes that have no type yet
        self._made: dict[str, typing.Any] = {"/": layer}

    def fill(self, content: typing.Iterable[tuple[str, int, dict[str, bytes]]]) -> set[str]:
        """Makes all specs in a layer that has none. Returns the asset paths of the layers that it uses."""
        assets: set[str] = set()
        for path, kind, fields in content:
            spec, written = self._make(path, kind, fields)
            if spec is None:
                continue
            if kind != ROOT:
                self._made[path] = spec
            for field in fields.keys() - written:
                write(spec, path, field, fields[field], self._memory)
            assets |= assets_of(fields)
        return assets

    def _make(self, path: str, kind: int, fields: dict[str, bytes]) -> tuple[typing.Any, set[str]]:
        """Creates a spec. Returns it, or None if this OpenUSD cannot express it, and the fields that it then has."""
        if kind == ROOT:
            return self._layer.pseudoRoot, set()
        owner, name = self._made.get(_session.parent_of(path)), _session.name_of(path)
        if owner is None:
            return None, set()
        if kind == PRIM:
            type_name = _text(fields["typeName"]) if "typeName" in fields else ""
            return Sdf.PrimSpec(owner, name, _decoded(fields, "specifier", Sdf.SpecifierOver), type_name), {"specifier", "typeName"}
        if kind == VARIANT_SET:
            return Sdf.VariantSetSpec(owner, name), set()
        if kind == VARIANT:
            return Sdf.VariantSpec(owner, name).primSpec, set()
        custom, variability = _decoded(fields, "custom", False), _decoded(fields, "variability", Sdf.VariabilityVarying)
        if kind == RELATIONSHIP:
            return Sdf.RelationshipSpec(owner, name, custom, _decoded(fields, "variability", Sdf.VariabilityUniform)), {
                "custom", "variability"}
        type_of_value = Sdf.ValueTypeNames.Find(_text(fields["typeName"])) if "typeName" in fields else None
        if not type_of_value:
            return None, set()
        return Sdf.AttributeSpec(owner, name, type_of_value, variability, custom), {"typeName", "custom", "variability"}

    def create(self, path: str, kind: int) -> None:
        if object_at(self._layer, path) is not None:
            return
        name = _session.name_of(path)
        if kind == ATTRIBUTE:
            self._late[path] = {}  # made with its type
            return
        above = _session.parent_of(path)
        parent = self._layer if above == "/" else self._layer.GetObjectAtPath(above) if kind == VARIANT else object_at(
            self._layer, above)
        if parent is None:
            return
        if kind == PRIM:
            Sdf.PrimSpec(parent, name, Sdf.SpecifierOver)
        elif kind == RELATIONSHIP:
            Sdf.RelationshipSpec(parent, name, False)
        elif kind == VARIANT_SET:
            Sdf.VariantSetSpec(parent, name)
        elif kind == VARIANT:
            Sdf.VariantSpec(parent, name)

    def delete(self, path: str) -> None:
        self._late.pop(path, None)
        spec = self._layer.GetObjectAtPath(path)
        if spec is None:
            return
        if isinstance(spec, Sdf.VariantSpec):
            spec.owner.RemoveVariant(spec)
        elif isinstance(spec, Sdf.VariantSetSpec):
            del object_at(self._layer, _session.parent_of(path)).variantSets[spec.name]
        elif isinstance(spec, Sdf.PropertySpec):
            object_at(self._layer, _session.parent_of(path)).RemoveProperty(spec)
        else:
            above = _session.parent_of(path)
            children = self._layer.rootPrims if above == "/" else object_at(self._layer, above).nameChildren
            del children[spec.name]

    def move(self, path: str, to: str) -> None:
        within = _session.parent_of(path) == _session.parent_of(to)
        is_variant = isinstance(self._layer.GetObjectAtPath(path), (Sdf.VariantSpec, Sdf.VariantSetSpec))
        if not is_variant and self._apply((path, to, Sdf.NamespaceEdit.same if within else -1)):
            return
        # Sdf moves no variants, and refuses some moves into variants.
        if Sdf.CopySpec(self._layer, path, self._layer, to):
            self.delete(path)

    def place(self, path: str, before: str) -> None:
        """Sdf orders a spec only while it renames it."""
        spec = self._layer.GetObjectAtPath(path)
        if not isinstance(spec, (Sdf.PrimSpec, Sdf.PropertySpec)):
            return
        names = self._siblings(path, spec)
        names.remove(spec.name)
        index = names.index(before) if before in names else -1
        free = next(name for name in (f"usdlivePlacing{number}" for number in range(len(names) + 1)) if name not in names)
        between = re.sub(r"[^/.}]*$", "", path) + free if isinstance(spec, Sdf.PrimSpec) else str(
            spec.path.ReplaceName(free))
        self._apply((path, between, -1), (between, path, index))

    def _siblings(self, path: str, spec: Sdf.Spec) -> list[str]:
        above = _session.parent_of(path)
        owner = self._layer if above == "/" else object_at(self._layer, above)
        return child_names(owner.pseudoRoot if above == "/" else owner, "properties" if isinstance(spec, Sdf.PropertySpec) else "primChildren")

    def _apply(self, *edits: tuple[str, str, int]) -> bool:
        batch = Sdf.BatchNamespaceEdit()
        for path, to, index in edits:
            batch.Add(path, to, index)
        return self._layer.Apply(batch)

    def field(self, path: str, field: str, data: bytes | None) -> None:
        """Sets a field, or erases it without `data` and where this OpenUSD cannot express the value."""
        if path in self._late:
            self._late[path][field] = data
            if field != "typeName" or not self._make_attribute(path, data):
                return
            for other, each in self._late.pop(path).items():
                if other != "typeName":
                    self.field(path, other, each)
            return
        spec = object_at(self._layer, path)
        if spec is not None:
            write(spec, path, field, data, self._memory)

    def _make_attribute(self, path: str, data: bytes | None) -> bool:
        kind = Sdf.ValueTypeNames.Find(_text(data)) if data else None
        owner = object_at(self._layer, _session.parent_of(path))
        if not kind or owner is None:
            return False
        Sdf.AttributeSpec(owner, _session.name_of(path), kind)
        return True


def _decoded(fields: dict[str, bytes], field: str, otherwise: typing.Any) -> typing.Any:
    return values.decode(fields[field]) if field in fields else otherwise


def _text(data: bytes) -> str:
    return values.header(data)[1][4:].decode()


def write(spec: Sdf.Spec, path: str, field: str, data: bytes | None, memory: Memory) -> bool:
    """Sets or erases a field. Returns False if this OpenUSD cannot express the value; the spec is then without it."""
    try:
        if data is not None:
            _set(spec, field, data)
            if values.header(data)[0] == values.DICTIONARY or field == "references":
                memory.note(path, field, spec.GetInfo(field), data)
            return True
    except (Unsupported, Tf.ErrorException, TypeError, ValueError, RuntimeError):
        pass
    _erase(spec, field)
    return data is None


def _set(spec: typing.Any, field: str, data: bytes) -> None:
    if field == "subLayers":
        _set_sublayers(spec.layer, values.decode(data))
    elif field in _PATH_LISTS:
        explicit, lists = values.decoded_list(data)
        proxy = getattr(spec, _PATH_LISTS[field])
        proxy.ClearEditsAndMakeExplicit() if explicit else proxy.ClearEdits()
        for name, items in zip(values.LISTS, lists):
            if items:
                getattr(proxy, name)[:] = items
    elif field == "timeSamples":
        _set_samples(spec, values.decode(data))
    else:
        spec.SetInfo(field, values.decode(data, field))


def _set_samples(spec: typing.Any, samples: dict) -> None:
    layer, path = spec.layer, spec.path
    if not samples:
        raise Unsupported("no sample can be expressed here")
    present = set(layer.ListTimeSamplesForPath(path))
    for time in present - samples.keys():
        layer.EraseTimeSample(path, time)
    for time, value in samples.items():
        layer.SetTimeSample(path, time, value)


def _set_sublayers(layer: Sdf.Layer, sublayers: list) -> None:
    if list(layer.subLayerPaths) != [path for path, _ in sublayers]:
        layer.subLayerPaths[:] = [path for path, _ in sublayers]
    for index, (_, offset) in enumerate(sublayers):
        if layer.subLayerOffsets[index] != offset:
            layer.subLayerOffsets[index] = offset


def _erase(spec: typing.Any, field: str) -> None:
    if field == "subLayers":
        spec.layer.subLayerPaths[:] = []
    elif field in _PATH_LISTS:
        getattr(spec, _PATH_LISTS[field]).ClearEdits()
    elif field == "timeSamples":
        for time in spec.layer.ListTimeSamplesForPath(spec.path):
            spec.layer.EraseTimeSample(spec.path, time)
    elif spec.HasInfo(field):
        spec.ClearInfo(field)


def stays(layer: Sdf.Layer, path: str, field: str, data: bytes) -> bool:
    """Whether content that the layer does not have is only what this OpenUSD cannot express (so that nobody has erased it)."""
    if not field:
        return False  # a spec
    number = values.header(data)[0]
    spec = object_at(layer, path)
    try:
        value = values.decode(data, field)
    except Unsupported:
        return True
    if spec is None:
        return False
    if field == "timeSamples":
        return number == values.SAMPLES and not value
    if not is_known(spec, field):
        return True
    if _type_of(spec, field) == "VtDictionary":
        return False
    return not _can_be_set(spec, field, data)


def _can_be_set(spec: Sdf.Spec, field: str, data: bytes) -> bool:
    if field in ("subLayers", *_PATH_LISTS):
        return True
    scratch = Sdf.Layer.CreateAnonymous(".usda")
    writer = Writer(scratch, Memory())
    if isinstance(spec, Sdf.PseudoRootSpec):
        return write(scratch.pseudoRoot, "/", field, data, Memory())
    writer.create("/P", PRIM)
    path = "/P"
    if isinstance(spec, Sdf.AttributeSpec):
        path = "/P.p"
        Sdf.AttributeSpec(scratch.GetPrimAtPath("/P"), "p", spec.typeName)
    elif isinstance(spec, Sdf.RelationshipSpec):
        path = "/P.p"
        writer.create(path, RELATIONSHIP)
    elif isinstance(spec, Sdf.VariantSetSpec):
        path = "/P{p=}"
        writer.create(path, VARIANT_SET)
    return write(scratch.GetObjectAtPath(path), path, field, data, Memory())
