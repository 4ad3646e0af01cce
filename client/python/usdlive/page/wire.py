"""The bytes and the JSON that the gateway sends (docs/page.md). Decides without I/O."""

from __future__ import annotations

import json
import math
import struct
import typing

import numpy

BATCH = 0x55534C50
GEOMETRY = 0x55534C47

# Sections of a batch.
MATRICES, VISIBILITY, COLOURS, GEOMETRIES, INSTANCES = 1, 2, 3, 4, 6
# Kinds of a geometry, and its sections.
MESH, CURVES, POINTS = 1, 2, 3
POSITIONS, NORMALS, UVS, VERTEX_COLOURS, INDICES, FACES, WIDTHS, FLAGS = range(1, 9)
SMOOTH = 1  # a bit of FLAGS: without normals, the page computes smooth ones

Section = tuple[int, int, bytes]


def pack(magic: int, head: tuple[int, ...], sections: typing.Sequence[Section]) -> bytes:
    """Returns sections (kind, count, bytes) behind a head. The bytes of each are filled up to a multiple of 4."""
    parts = [struct.pack(f"<{2 + len(head)}I", magic, *head, len(sections))]
    for kind, count, content in sections:
        content += b"\0" * (-len(content) % 4)
        parts += [struct.pack("<3I", kind, count, len(content)), content]
    return b"".join(parts)


def batch(sections: typing.Sequence[Section]) -> bytes:
    return pack(BATCH, (), sections)


def ids(numbers: typing.Iterable[int]) -> bytes:
    return numpy.fromiter(numbers, "<u4").tobytes()


def floats(values: object) -> bytes:
    return numpy.ascontiguousarray(values, "<f4").tobytes()


def rows(matrices: object) -> numpy.ndarray:
    """The first three columns of 4x4 matrices, as 12 numbers each."""
    return numpy.asarray(matrices, float).reshape(-1, 4, 4)[:, :, :3].reshape(-1, 12)


def text(message: dict) -> str:
    """Returns a message as JSON. Numbers that JSON does not have are null."""
    try:
        return json.dumps(message, allow_nan=False, separators=(",", ":"))
    except ValueError:
        return json.dumps(finite(message), allow_nan=False, separators=(",", ":"))


def finite(value: object) -> object:
    """The value with null in place of NaN and infinite numbers."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: finite(one) for key, one in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(one) for one in value]
    return value
