"""Values of the protocol (PROTOCOL.md, V1-V11) to values of the `pxr` of this process, and back.

A value that this OpenUSD cannot express raises Unsupported. Of a dictionary and of time samples, the other parts are
decoded nevertheless; whoever writes them back keeps the rest.
"""

from __future__ import annotations

import array
import struct
import typing

from pxr import Gf, Sdf, Vt

DICTIONARY, SAMPLES, LIST, MAP = 80, 81, 82, 83
ARRAY, ARRAY_EDIT = 0x100, 0x200
STRING, TOKEN, ASSET, EXPRESSION, PATH, OPAQUE, TIME_CODE = 11, 12, 13, 14, 15, 16, 10
BLOCK, ANIMATION_BLOCK, SPECIFIER, VARIABILITY, PERMISSION = 50, 51, 53, 54, 55
TOKENS, STRINGS, REFERENCE, PAYLOAD, SUBLAYER, UNREGISTERED = 56, 57, 58, 59, 60, 61
_TEXTS = (STRING, TOKEN, ASSET, EXPRESSION, PATH)


class Unsupported(Exception):
    """This OpenUSD, or this backend, cannot express a value. The text says which one."""


class _Numbers(typing.NamedTuple):
    """A type of fixed size: the format and count of its numbers, and its class in Gf (None: a Python number) and Vt."""

    letter: str
    count: int
    single: type | None
    many: type
    shape: tuple[int, ...] = ()


def _numbers() -> dict[int, _Numbers]:
    plain = {1: ("?", "Bool"), 2: ("B", "UChar"), 3: ("i", "Int"), 4: ("I", "UInt"), 5: ("q", "Int64"), 6: ("Q", "UInt64"),
             7: ("e", "Half"), 8: ("f", "Float"), 9: ("d", "Double")}
    types = {number: _Numbers(letter, 1, None, getattr(Vt, f"{name}Array")) for number, (letter, name) in plain.items()}
    for number, size in ((20, 2), (21, 3), (22, 4)):
        types[number] = _Numbers("d", size * size, getattr(Gf, f"Matrix{size}d"), getattr(Vt, f"Matrix{size}dArray"), (size, size))
    for number, letter in ((23, "h"), (24, "f"), (25, "d")):
        types[number] = _Numbers(letter.replace("h", "e"), 4, getattr(Gf, f"Quat{letter}"), getattr(Vt, f"Quat{letter}Array"), (4,))
    for size, first in ((2, 26), (3, 30), (4, 34)):
        for number, letter in enumerate("ihfd", first):
            types[number] = _Numbers(letter.replace("h", "e"), size, getattr(Gf, f"Vec{size}{letter}"),
                                     getattr(Vt, f"Vec{size}{letter}Array"), (size,))
    return types


_NUMBERS = _numbers()
# Values that Python would turn into another type of C++.
_WRAPPED = {2: Vt.UChar, 4: Vt.UInt, 5: Vt.Int64, 6: Vt.UInt64, 7: Vt.Half, 8: Vt.Float, TOKEN: Vt.Token}
_TIME_CODE = getattr(Gf, "TimeCode", None) or Sdf.TimeCode
_TIME_CODES = getattr(Vt, "TimeCodeArray", None) or Sdf.TimeCodeArray
_TEXT_ARRAYS = {STRING: Vt.StringArray, TOKEN: Vt.TokenArray, ASSET: Sdf.AssetPathArray,
                EXPRESSION: getattr(Sdf, "PathExpressionArray", None)}
_BY_CLASS: dict[type, int] = {each.single: number for number, each in _NUMBERS.items() if each.single}
_BY_CLASS |= {each.many: number | ARRAY for number, each in _NUMBERS.items()}
_BY_CLASS |= {many: number | ARRAY for number, many in _TEXT_ARRAYS.items() if many}
_BY_CLASS |= {_TIME_CODE: TIME_CODE, _TIME_CODES: TIME_CODE | ARRAY, Sdf.AssetPath: ASSET, Sdf.PathExpression: EXPRESSION,
              Sdf.Path: PATH, Sdf.Specifier: SPECIFIER, Sdf.Variability: VARIABILITY, Sdf.Permission: PERMISSION,
              Sdf.Reference: REFERENCE, Sdf.Payload: PAYLOAD, Sdf.OpaqueValue: OPAQUE}
_PYTHON = {bool: 1, int: 3, float: 9, str: STRING}
_BLOCKS = (Sdf.ValueBlock, Sdf.AnimationBlock) if hasattr(Sdf, "AnimationBlock") else (Sdf.ValueBlock,)
_ENUMS = {SPECIFIER: (Sdf.SpecifierDef, Sdf.SpecifierOver, Sdf.SpecifierClass),
          VARIABILITY: (Sdf.VariabilityVarying, Sdf.VariabilityUniform),
          PERMISSION: (Sdf.PermissionPublic, Sdf.PermissionPrivate)}
_LIST_OPS = {3: Sdf.IntListOp, 4: Sdf.UIntListOp, 5: Sdf.Int64ListOp, 6: Sdf.UInt64ListOp, STRING: Sdf.StringListOp,
             TOKEN: Sdf.TokenListOp, PATH: Sdf.PathListOp, REFERENCE: Sdf.ReferenceListOp, PAYLOAD: Sdf.PayloadListOp}
_ITEM_TYPES = {kind: number for number, kind in _LIST_OPS.items()}
LISTS = ("explicitItems", "addedItems", "prependedItems", "appendedItems", "deletedItems", "orderedItems")
TEXT_ORDER = ("explicitItems", "deletedItems", "addedItems", "prependedItems", "appendedItems", "orderedItems")  # the order of the text


# --- decoding

class _Reader:
    def __init__(self, data: bytes):
        self._data, self._at = data, 0

    def take(self, count: int) -> bytes:
        self._at += count
        return self._data[self._at - count:self._at]

    def numbers(self, layout: str) -> tuple:
        values = struct.unpack_from("<" + layout, self._data, self._at)
        self._at += struct.calcsize("<" + layout)
        return values

    def text(self) -> str:
        return self.take(self.numbers("I")[0]).decode()


def header(data: bytes) -> tuple[int, bytes]:
    """Returns the type of an encoded field, and its content."""
    return struct.unpack_from("<H", data)[0], data[11:]


def decode(data: bytes, field: str = "") -> object:
    """Returns the value of an encoded field (V10), as `SetInfo()` and the constructors of Sdf take it. Time samples are
    a dict, and `subLayers` a list of (path, Sdf.LayerOffset)."""
    return _content(*header(data), field)


def decoded_list(data: bytes) -> tuple[bool, list[list]]:
    """Returns whether a list op is explicit, and its lists in the order of LISTS."""
    reader = _Reader(header(data)[1])
    _, explicit = reader.numbers("HB")
    return bool(explicit), [[_item(reader) for _ in range(reader.numbers("I")[0])] for _ in LISTS]


def _content(number: int, body: bytes, field: str) -> object:
    reader = _Reader(body)
    if number == DICTIONARY:
        return _dictionary(reader)
    if number == SAMPLES:
        samples = {}
        for _ in range(reader.numbers("Q")[0]):
            time = reader.numbers("d")[0]
            _add(samples, time, lambda: _leaf(reader), reader)
        return samples
    if number == LIST:
        return _list_op(reader, field)
    if number == MAP:
        kind, count = reader.numbers("HI")
        pairs = [(_item(reader), _item(reader)) for _ in range(count)]
        return dict(pairs) if kind == STRING or field == "relocates" else pairs
    if number == TOKEN and field == "displayUnit":
        return Sdf.GetUnitFromName(body[4:].decode())
    return decode_leaf(number, body)


def _next(reader: _Reader) -> tuple[int, bytes]:
    number, _, size = reader.numbers("HBQ")
    return number, reader.take(size)


def _leaf(reader: _Reader) -> object:
    return decode_leaf(*_next(reader))


def _item(reader: _Reader) -> object:
    """A list item: list ops take no wrapped values."""
    number, body = _next(reader)
    if number == TOKEN:
        return body[4:].decode()
    if number in _WRAPPED:
        return struct.unpack(f"<{_NUMBERS[number].letter}", body)[0]
    return decode_leaf(number, body)


def _add(parts: dict, key: object, read: typing.Callable[[], object], reader: _Reader) -> None:
    try:
        parts[key] = read()
    except Unsupported:
        pass  # `reader` is behind the part already


def _dictionary(reader: _Reader) -> dict:
    entries: dict = {}
    for _ in range(reader.numbers("I")[0]):
        key = reader.text()
        number, body = _next(reader)
        _add(entries, key, lambda number=number, body=body: _content(number, body, ""), reader)
    return entries


def _list_op(reader: _Reader, field: str) -> object:
    number, explicit = reader.numbers("HB")
    lists = [[_item(reader) for _ in range(reader.numbers("I")[0])] for _ in LISTS]
    if number == SUBLAYER:
        return lists[0]
    kind = _LIST_OPS.get(number)
    if kind is None:
        raise Unsupported(f"{field} has list items of type {number}")
    if explicit:
        return kind.CreateExplicit(lists[0])
    made = kind()
    for name, items in zip(LISTS[1:], lists[1:]):
        if items:
            setattr(made, name, items)
    return made


def decode_leaf(number: int, body: bytes) -> object:
    if number in _NUMBERS:
        kind = _NUMBERS[number]
        values = struct.unpack(f"<{kind.count}{kind.letter}", body)
        if kind.single is None:
            return _WRAPPED[number](values[0]) if number in _WRAPPED else values[0]
        return _vector(kind, values)
    if number & ARRAY:
        return _decode_array(number & 0xFF, body)
    if number in _TEXTS:
        text = body[4:].decode()
        return {STRING: str, TOKEN: Vt.Token, ASSET: Sdf.AssetPath, EXPRESSION: Sdf.PathExpression, PATH: _path}[number](text)
    if number in _ENUMS:
        return _ENUMS[number][body[0]]
    reader = _Reader(body)
    if number in (TOKENS, STRINGS):
        return [reader.text() for _ in range(reader.numbers("I")[0])]
    if number == TIME_CODE:
        return _TIME_CODE(reader.numbers("d")[0])
    if number == BLOCK:
        return Sdf.ValueBlock()
    if number == ANIMATION_BLOCK and hasattr(Sdf, "AnimationBlock"):
        return Sdf.AnimationBlock()
    if number in (REFERENCE, PAYLOAD):
        asset, path, offset = reader.text(), _path(reader.text()), Sdf.LayerOffset(*reader.numbers("dd"))
        return Sdf.Payload(asset, path, offset) if number == PAYLOAD else Sdf.Reference(asset, path, offset, _dictionary(reader))
    if number == SUBLAYER:
        return reader.text(), Sdf.LayerOffset(*reader.numbers("dd"))
    raise Unsupported(f"a value of type {number} cannot be expressed here")


def _path(text: str) -> Sdf.Path:
    return Sdf.Path(text) if text else Sdf.Path()


def _vector(kind: _Numbers, values: tuple) -> object:
    if kind.single in (Gf.Quath, Gf.Quatf, Gf.Quatd):
        return kind.single(values[3], *values[:3])
    return kind.single(*values)


def _decode_array(number: int, body: bytes) -> object:
    count, data = struct.unpack_from("<Q", body)[0], memoryview(body)[8:]
    if number in _NUMBERS:
        kind = _NUMBERS[number]
        if count == 0:
            return kind.many()
        if kind.letter == "e":  # memoryview has no halves
            data, letter = memoryview(array.array("f", struct.unpack(f"<{len(data) // 2}e", data))).cast("B"), "f"
        else:
            letter = kind.letter
        shaped = data.cast(letter, (count, *kind.shape)) if kind.shape else data.cast(letter)
        return kind.many.FromBuffer(shaped) if hasattr(kind.many, "FromBuffer") else kind.many(shaped)
    if number == TIME_CODE:
        return _TIME_CODES([_TIME_CODE(time) for time in struct.unpack(f"<{count}d", data)])
    many = _TEXT_ARRAYS.get(number)
    if many is None:
        raise Unsupported(f"an array of type {number} cannot be expressed here")
    reader = _Reader(bytes(data))
    single = {ASSET: Sdf.AssetPath, EXPRESSION: Sdf.PathExpression}.get(number, str)
    return many([single(reader.text()) for _ in range(count)])


# --- encoding

def _framed(number: int, body: bytes) -> bytes:
    return struct.pack("<HBQ", number, 0, len(body)) + body


def _text(text: str) -> bytes:
    data = text.encode()
    return struct.pack("<I", len(data)) + data


def encode(value: object, number: int | None = None, types: dict | None = None) -> bytes:
    """Returns the encoded field. `number`: the type where the class of the value does not say it (int, float, str, list);
    of time samples, that of the samples. `types`: those of the entries of a dictionary or of a reference's custom data, by key."""
    return _framed(*_encoded(value, number, types))


def encode_samples(samples: dict, number: int | None) -> bytes:
    body = b"".join(struct.pack("<d", time) + encode(samples[time], number) for time in sorted(samples))
    return _framed(SAMPLES, struct.pack("<Q", len(samples)) + body)


def encode_map(pairs: typing.Iterable[tuple], number: int) -> bytes:
    entries = [encode(key, number) + encode(value, number) for key, value in pairs]
    return _framed(MAP, struct.pack("<HI", number, len(entries)) + b"".join(entries))


def encode_sublayers(layers: typing.Iterable[tuple[str, Sdf.LayerOffset]]) -> bytes:
    items = [_framed(SUBLAYER, _text(path) + struct.pack("<dd", offset.offset, offset.scale)) for path, offset in layers]
    return encode_lists(SUBLAYER, True, [items])


def encode_lists(number: int, explicit: bool, lists: list[list[bytes]]) -> bytes:
    body = struct.pack("<HB", number, explicit)
    for items in [*lists, *[[]] * (len(LISTS) - len(lists))]:
        body += struct.pack("<I", len(items)) + b"".join(items)
    return _framed(LIST, body)


def encode_list_op(value: typing.Any, types: typing.Iterable[dict] = ()) -> bytes:
    """`types`: those of the custom data of the references that have some, in the order of TEXT_ORDER."""
    number, left = _ITEM_TYPES[type(value)], iter(types)
    lists = {}
    for name in TEXT_ORDER:
        lists[name] = [encode(item, number, next(left, {}) if getattr(item, "customData", None) else None)
                       for item in getattr(value, name)]
    return encode_lists(number, value.isExplicit, [lists[name] for name in LISTS])


def is_ambiguous(value: object) -> bool:
    """Whether Python does not tell the types of all entries of a dictionary."""
    return any(map(is_ambiguous, value.values())) if isinstance(value, dict) else type(value) in (int, float, str)


def is_list_op(value: object) -> bool:
    return type(value) in _ITEM_TYPES


def _encoded(value: object, number: int | None, types: dict | None) -> tuple[int, bytes]:
    number = _BY_CLASS.get(type(value), number)
    if isinstance(value, dict):
        return DICTIONARY, _encoded_dictionary(value, types or {})
    if isinstance(value, _BLOCKS):
        return BLOCK if isinstance(value, Sdf.ValueBlock) else ANIMATION_BLOCK, b""
    if number is None:
        number = _PYTHON.get(type(value))
    if number is None:
        raise Unsupported(f"a value of class {type(value).__name__} cannot be shared by this backend")
    try:
        return number, _body(value, number, types)
    except (struct.error, TypeError, AttributeError, OverflowError, KeyError) as error:
        raise Unsupported(f"{value!r} is no value of type {number} ({error})") from None


def _encoded_dictionary(value: dict, types: dict) -> bytes:
    entries = sorted((key.encode(), entry, types.get(key)) for key, entry in value.items())
    body = struct.pack("<I", len(entries))
    for key, entry, kind in entries:
        nested = isinstance(entry, dict)
        body += struct.pack("<I", len(key)) + key + encode(entry, None if nested else kind, kind if nested else None)
    return body


def _body(value: typing.Any, number: int, types: dict | None = None) -> bytes:
    if number in _NUMBERS:
        kind = _NUMBERS[number]
        return struct.pack(f"<{kind.count}{kind.letter}", *_flat(kind, value))
    if number & ARRAY:
        return struct.pack("<Q", len(value)) + _elements(value, number & 0xFF)
    if number == ASSET:
        return _text(getattr(value, "authoredPath", None) or value.path)
    if number == EXPRESSION:
        return _text(value.GetText())
    if number in _TEXTS:
        return _text(str(value))
    if number in _ENUMS:
        return bytes([_ENUMS[number].index(value)])
    if number in (TOKENS, STRINGS):
        return struct.pack("<I", len(value)) + b"".join(_text(one) for one in value)
    if number == TIME_CODE:
        return struct.pack("<d", value.GetValue())
    if number == OPAQUE:
        return b""
    if number in (REFERENCE, PAYLOAD):
        body = _text(value.assetPath) + _text(str(value.primPath)) + struct.pack("<dd", value.layerOffset.offset,
                                                                                 value.layerOffset.scale)
        return body if number == PAYLOAD else body + _encoded_dictionary(value.customData, types or {})
    raise Unsupported(f"a value of type {number} cannot be shared by this backend")


def _flat(kind: _Numbers, value: typing.Any) -> typing.Iterable:
    if kind.single is None:
        return (value,)
    if len(kind.shape) == 2:
        return (number for row in value for number in row)
    if kind.single in (Gf.Quath, Gf.Quatf, Gf.Quatd):
        return (*value.imaginary, value.real)
    return value


def _elements(value: typing.Any, number: int) -> bytes:
    if number in _NUMBERS:
        return bytes(memoryview(value)) if len(value) else b""
    if number == TIME_CODE:
        return struct.pack(f"<{len(value)}d", *(time.GetValue() for time in value))
    return b"".join(_body(one, number) for one in value)
