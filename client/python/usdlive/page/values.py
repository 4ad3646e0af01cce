"""Values of OpenUSD as JSON, as the commands print them, and back."""

from __future__ import annotations

import math
import typing

import usdlive
from pxr import Gf, Sdf

MOST_ITEMS = 256  # the most of an array; longer ones are not sent
MOST_TEXT = 2000
_INTEGERS = {"uchar": (0, 255), "int": (-2 ** 31, 2 ** 31 - 1), "uint": (0, 2 ** 32 - 1), "int64": (-2 ** 63, 2 ** 63 - 1),
             "uint64": (0, 2 ** 64 - 1)}
_FLOATS = ("half", "float", "double", "timecode")


def to_json(value: typing.Any) -> typing.Any:
    """Numbers, texts, lists and dictionaries. A long array is null."""
    if value is None or isinstance(value, (bool, int, str)):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else str(value)
    if isinstance(value, Sdf.ValueBlock):
        return None
    if isinstance(value, Sdf.AssetPath):
        return value.path
    if isinstance(value, Sdf.TimeCode):
        return to_json(value.GetValue())
    if isinstance(value, (Gf.Quatd, Gf.Quatf, Gf.Quath)):
        return [to_json(float(one)) for one in (*value.GetImaginary(), value.GetReal())]
    if isinstance(value, dict):
        return {str(name): to_json(one) for name, one in list(value.items())[:MOST_ITEMS]}
    if hasattr(value, "__len__") and hasattr(value, "__getitem__"):
        return None if len(value) > MOST_ITEMS else [to_json(value[one]) for one in range(len(value))]
    return str(value)[:MOST_TEXT]


def to_text(value: typing.Any) -> str:
    """The value for people; a long one ends with dots."""
    if value is None:
        return ""
    if isinstance(value, Sdf.ValueBlock):
        return "blocked"
    if hasattr(value, "__len__") and not isinstance(value, (str, dict)) and len(value) > MOST_ITEMS:
        shown = ", ".join(str(value[one]) for one in range(min(len(value), 64)))
        return f"[{shown}, ...] ({len(value)} items)"[:MOST_TEXT]
    text = f"@{value.path}@" if isinstance(value, Sdf.AssetPath) else str(value)
    return text if len(text) <= MOST_TEXT else text[:MOST_TEXT - 3] + "..."


def _wrong(kind: Sdf.ValueTypeName, value: typing.Any) -> usdlive.Error:
    return usdlive.Error("invalidArgument", f"{str(value)[:80]} is no value of the type {kind}")


def from_json(kind: Sdf.ValueTypeName, value: typing.Any) -> typing.Any:
    """The value of a type. Raises an Error if it is none."""
    try:
        if kind.isArray:
            if not isinstance(value, list):
                raise _wrong(kind, value)
            scalar = kind.scalarType
            return kind.type.pythonClass([_scalar(scalar, one) for one in value])
        return _scalar(kind, value)
    except usdlive.Error:
        raise
    except (TypeError, ValueError, OverflowError, AttributeError) as wrong:
        raise usdlive.Error("invalidArgument", f"{str(value)[:80]} is no value of the type {kind}: {wrong}") from None


def _number(kind: Sdf.ValueTypeName, value: typing.Any) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise _wrong(kind, value)
    return float(value)


def _scalar(kind: Sdf.ValueTypeName, value: typing.Any) -> typing.Any:
    name = str(kind.type.typeName)
    alias = kind.aliasesAsStrings[0] if kind.aliasesAsStrings else str(kind)
    if alias == "bool":
        if not isinstance(value, bool):
            raise _wrong(kind, value)
        return value
    if alias in _INTEGERS:
        least, most = _INTEGERS[alias]
        if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
            raise _wrong(kind, value)
        return value
    if alias in _FLOATS:
        number = _number(kind, value)
        return Sdf.TimeCode(number) if alias == "timecode" else number
    if alias in ("string", "token", "asset"):
        if not isinstance(value, str):
            raise _wrong(kind, value)
        return Sdf.AssetPath(value) if alias == "asset" else value
    made = kind.type.pythonClass
    if made is None or not isinstance(value, list):
        raise _wrong(kind, value)
    if made in (Gf.Quatd, Gf.Quatf, Gf.Quath):
        numbers = [_number(kind, one) for one in value]
        if len(numbers) != 4:
            raise _wrong(kind, value)
        return made(numbers[3], *numbers[:3])
    if name.startswith("GfMatrix"):
        rows = [[_number(kind, one) for one in row] for row in value]
        if len(rows) != made.dimension[0] or any(len(row) != made.dimension[1] for row in rows):
            raise _wrong(kind, value)
        return made(*[one for row in rows for one in row])
    numbers = [_number(kind, one) for one in value]
    if len(numbers) != made.dimension:
        raise _wrong(kind, value)
    if alias.startswith("int"):
        return made(*[int(one) for one in numbers])
    return made(*numbers)


