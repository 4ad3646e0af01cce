"""Arrays of a mesh, and the blob that they make. Decides without OpenUSD and without I/O."""

from __future__ import annotations

import dataclasses
import functools
import hashlib

import numpy

from . import wire

# More than this is not drawn: a browser could not hold it.
MOST_INDICES = 48_000_000


@dataclasses.dataclass
class Shape:
    """Something that is drawn: `indices` are triangles of a mesh, or the two ends of each line. Normals, uvs and colours are for each
    point, or None."""

    kind: int
    points: numpy.ndarray
    indices: numpy.ndarray | None = None
    normals: numpy.ndarray | None = None
    uvs: numpy.ndarray | None = None
    colours: numpy.ndarray | None = None
    widths: numpy.ndarray | None = None
    faces: numpy.ndarray | None = None
    smooth: bool = False

    @functools.cached_property
    def is_finite(self) -> bool:
        return bool(numpy.isfinite(self.points).all())

    @functools.cached_property
    def blob(self) -> tuple[bytes, str]:
        """The bytes for a page, and their SHA-256."""
        sections = [(wire.POSITIONS, len(self.points), wire.floats(self.points))]
        for kind, values in ((wire.NORMALS, self.normals), (wire.UVS, self.uvs), (wire.VERTEX_COLOURS, self.colours)):
            if values is not None:
                sections.append((kind, len(values), wire.floats(numpy.nan_to_num(values))))
        for kind, values in ((wire.INDICES, self.indices), (wire.FACES, self.faces)):
            if values is not None:
                sections.append((kind, len(values), numpy.ascontiguousarray(values, "<u4").tobytes()))
        if self.widths is not None:
            sections.append((wire.WIDTHS, len(self.widths), wire.floats(numpy.nan_to_num(self.widths))))
        if self.smooth:
            sections.append((wire.FLAGS, 1, wire.ids([wire.SMOOTH])))
        content = wire.pack(wire.GEOMETRY, (self.kind,), sections)
        return content, hashlib.sha256(content).hexdigest()


@dataclasses.dataclass
class Faces:
    """The polygons of a mesh that can be drawn. `corners` are places in the mesh's list of face vertices, three for each
    triangle, and `of` is the polygon of each triangle."""

    corners: numpy.ndarray
    of: numpy.ndarray
    problem: str = ""


def triangulated(counts: numpy.ndarray, indices: numpy.ndarray, points: numpy.ndarray, holes: numpy.ndarray,
                 left_handed: bool) -> Faces:
    """Cuts polygons into fans of triangles. Polygons that name points that are not there or not finite, holes, and
    polygons with less than three points are left out."""
    problem = ""
    nothing = Faces(numpy.zeros(0, numpy.int64), numpy.zeros(0, numpy.int64))
    if len(counts) and counts.min() < 0:
        nothing.problem = "a polygon has a negative number of points"
        return nothing
    ends = numpy.cumsum(counts, dtype=numpy.int64)
    starts = ends - counts
    drawn = counts >= 3
    if not drawn.all():
        problem = f"{int((~drawn).sum())} polygons have less than three points"
    inside = ends <= len(indices)
    if not inside.all() or (len(ends) and ends[-1] != len(indices)) or (not len(ends) and len(indices)):
        problem = f"the polygons have {int(ends[-1]) if len(ends) else 0} points, and there are {len(indices)} indices"
        drawn &= inside
    if len(indices):
        wrong = (indices < 0) | (indices >= len(points))
        if wrong.any():
            problem = f"{int(wrong.sum())} indices name no point"
        finite = numpy.isfinite(points).all(axis=1) if len(points) else numpy.zeros(0, bool)
        if not finite.all():
            problem = f"{int((~finite).sum())} points are not finite"
        if wrong.any() or not finite.all():
            bad = wrong.copy()
            bad[~wrong] = ~finite[indices[~wrong]]
            sums = numpy.concatenate([[0], numpy.cumsum(bad)])
            limit = len(indices)
            drawn &= sums[numpy.minimum(ends, limit)] == sums[numpy.minimum(starts, limit)]
    valid = holes[(holes >= 0) & (holes < len(counts))]
    drawn[valid] = False
    number = numpy.where(drawn, counts - 2, 0)
    total = int(number.sum())
    if total * 3 > MOST_INDICES:
        nothing.problem = f"the mesh has {total} triangles, more than the {MOST_INDICES // 3} that are drawn"
        return nothing
    of = numpy.repeat(numpy.arange(len(counts)), number)
    within = numpy.arange(total) - numpy.repeat(numpy.cumsum(number) - number, number)
    first = starts[of]
    corners = numpy.stack([first, first + within + 1, first + within + 2], axis=1)
    return Faces(corners[:, [0, 2, 1] if left_handed else [0, 1, 2]].reshape(-1), of, problem)


def lines(counts: numpy.ndarray, closed: bool) -> numpy.ndarray:
    """The ends of the lines of curves that have so many points each, one curve after the other."""
    ends = numpy.cumsum(counts, dtype=numpy.int64)
    starts = ends - counts
    number = numpy.maximum(counts - 1, 0)
    of = numpy.repeat(numpy.arange(len(counts)), number)
    within = numpy.arange(int(number.sum())) - numpy.repeat(numpy.cumsum(number) - number, number)
    pairs = numpy.stack([starts[of] + within, starts[of] + within + 1], axis=1)
    if closed:
        long = counts > 2
        pairs = numpy.concatenate([pairs, numpy.stack([ends[long] - 1, starts[long]], axis=1)])
    return pairs.reshape(-1)
