"""Meshes of spheres, boxes and other shapes that USD describes by a few numbers. Decides without I/O."""

from __future__ import annotations

import math

import numpy

from . import wire
from .shapes import Shape

_AROUND = 32  # a multiple of 4: the points at the sides are exact


def _turned(shape: Shape, axis: str) -> Shape:
    """A shape along Z, along `axis`."""
    order = {"X": [2, 0, 1], "Y": [1, 2, 0]}.get(axis)
    if order:
        shape.points = shape.points[:, order]
        shape.normals = None if shape.normals is None else shape.normals[:, order]
    return shape


def _circle(radius: float) -> numpy.ndarray:
    angles = numpy.arange(_AROUND + 1) * (2 * math.pi / _AROUND)
    return radius * numpy.stack([numpy.cos(angles), numpy.sin(angles)], axis=1)


def _revolved(profile: list[tuple[float, float]], normals: list[tuple[float, float]]) -> Shape:
    """The surface of a profile of (radius, height) around Z, from the bottom to the top, with its normals."""
    around = _circle(1.0)
    points, directions = [], []
    for (radius, height), (out, up) in zip(profile, normals):
        points.append(numpy.column_stack([around * radius, numpy.full(_AROUND + 1, height)]))
        directions.append(numpy.column_stack([around * out, numpy.full(_AROUND + 1, up)]))
    ring = _AROUND + 1
    row, column = numpy.meshgrid(numpy.arange(len(profile) - 1), numpy.arange(_AROUND), indexing="ij")
    first = (row * ring + column).reshape(-1)
    triangles = numpy.stack([first, first + 1, first + ring + 1, first, first + ring + 1, first + ring], axis=1).reshape(-1, 3)
    return Shape(wire.MESH, numpy.concatenate(points), triangles.reshape(-1), normals=numpy.concatenate(directions))


def _arc(radius: float, centre: float, begin: float, end: float) -> tuple[list, list]:
    angles = [begin + (end - begin) * step / 8 for step in range(9)]
    return ([(radius * math.cos(a), centre + radius * math.sin(a)) for a in angles],
            [(math.cos(a), math.sin(a)) for a in angles])


def sphere(radius: float) -> Shape:
    profile, normals = _arc(radius, 0.0, -math.pi / 2, 0.0)
    above, upwards = _arc(radius, 0.0, 0.0, math.pi / 2)
    return _revolved(profile + above[1:], normals + upwards[1:])


def cylinder(bottom: float, top: float, height: float, axis: str) -> Shape:
    """Also a cone: `top` is 0 then."""
    half = height / 2
    slope = math.atan2(bottom - top, height) if height else 0.0
    out = (math.cos(slope), math.sin(slope))
    return _turned(_revolved([(0.0, -half), (bottom, -half), (bottom, -half), (top, half), (top, half), (0.0, half)],
                             [(0.0, -1.0), (0.0, -1.0), out, out, (0.0, 1.0), (0.0, 1.0)]), axis)


def capsule(bottom: float, top: float, height: float, axis: str) -> Shape:
    half = height / 2
    below, downwards = _arc(bottom, -half, -math.pi / 2, 0.0)
    above, upwards = _arc(top, half, 0.0, math.pi / 2)
    return _turned(_revolved(below + above, downwards + upwards), axis)


def cube(size: float) -> Shape:
    corners, normals = [], []
    for axis in range(3):
        for side in (-1.0, 1.0):
            for u, v in ((-1, -1), (1, -1), (1, 1), (-1, 1)) if side > 0 else ((-1, -1), (-1, 1), (1, 1), (1, -1)):
                corner = [0.0] * 3
                corner[axis], corner[(axis + 1) % 3], corner[(axis + 2) % 3] = side, u, v
                corners.append(corner)
                normals.append([side if one == axis else 0.0 for one in range(3)])
    uvs = numpy.tile([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]], (6, 1))
    first = numpy.arange(6)[:, None] * 4
    indices = (first + numpy.array([0, 1, 2, 0, 2, 3])).reshape(-1)
    return Shape(wire.MESH, numpy.array(corners) * (size / 2), indices, numpy.array(normals), uvs)


def plane(width: float, length: float, axis: str) -> Shape:
    x, y = width / 2, length / 2
    corners = numpy.array([[-x, -y, 0.0], [x, -y, 0.0], [x, y, 0.0], [-x, y, 0.0]])
    uvs = numpy.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    order = {"X": [2, 1, 0], "Y": [0, 2, 1]}.get(axis, [0, 1, 2])
    indices = [0, 1, 2, 0, 2, 3] if axis == "Z" else [0, 2, 1, 0, 3, 2]
    normals = numpy.tile([[0.0, 0.0, 1.0]], (4, 1))
    return Shape(wire.MESH, corners[:, order], numpy.array(indices), normals[:, order], uvs)
