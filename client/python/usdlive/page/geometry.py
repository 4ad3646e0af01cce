"""Reads the geometry of a prim with OpenUSD's classes. On the thread of the stage."""

from __future__ import annotations

import dataclasses
import functools
import typing

import numpy
from pxr import Sdf, Usd, UsdGeom, Vt

from . import gprims, shapes, wire
from .shapes import Shape

# A prim with more than this is not read: it would take seconds, in which nothing else moves.
MOST_POINTS = 16_000_000


@dataclasses.dataclass
class Geometry:
    """The result of reading a gprim. `colour` and `opacity`: of the whole prim. `order` sorts the polygons of a mesh for `subsets`, which are
    (path of the subset, first index, number of indices)."""

    shape: Shape | None = None
    colour: list[float] | None = None
    opacity: float | None = None
    subsets: list[tuple[str, int, int]] = dataclasses.field(default_factory=list)
    problem: str = ""


def array(values: object, columns: int = 0, kind: str = "f4") -> numpy.ndarray:
    """A Vt array, or None, as an array of numpy."""
    shape = (0, columns) if columns else (0,)
    if values is None or not len(values):
        return numpy.zeros(shape, kind)
    found = numpy.asarray(values)
    return found.reshape(-1, columns).astype(kind, copy=False) if columns else found.astype(kind, copy=False)


def value(prim: Usd.Prim, name: str, time: Usd.TimeCode, default: typing.Any) -> typing.Any:
    found = prim.GetAttribute(name).Get(time)
    return default if found is None else found


def read(prim: Usd.Prim, time: Usd.TimeCode, has_primvars: bool = True, points: Vt.Vec3fArray | None = None) -> Geometry:
    """Reads what a gprim looks like at a time. `points`: in place of the prim's own, for skinned meshes. `has_primvars`: of its
    own or inherited."""
    reader = _READERS.get(prim.GetTypeName()) or _reader_of(prim)
    result = Geometry()
    try:
        reader(prim, time, result, _Primvars(prim, time, has_primvars), points)
    except (ValueError, IndexError, OverflowError, MemoryError) as wrong:
        result.shape = None
        result.problem = f"cannot be drawn: {wrong}"
    if result.shape is not None and not result.shape.is_finite:
        if result.shape.kind == wire.MESH:  # the triangles with such points are left out
            result.shape = dataclasses.replace(result.shape, points=numpy.nan_to_num(result.shape.points, posinf=0, neginf=0))
            result.problem = result.problem or "some points are not finite"
        else:
            result.shape, result.problem = None, "some points are not finite"
    return result


def _bounded(number: int) -> None:
    if number > MOST_POINTS:
        raise ValueError(f"it has {number} points, more than the {MOST_POINTS} that are read")


class _Primvars:
    """Primvars for the points, or the corners, of something that is drawn."""

    def __init__(self, prim: Usd.Prim, time: Usd.TimeCode, exist: bool = True):
        self.api, self.time, self._exist = UsdGeom.PrimvarsAPI(prim), time, exist

    def find(self, name: str, columns: int) -> tuple[numpy.ndarray, str] | None:
        """Values and their interpolation; None without any."""
        if not self._exist:
            return None
        primvar = self.api.FindPrimvarWithInheritance(name)
        if not primvar or not primvar.HasValue():
            return None
        values = primvar.ComputeFlattened(self.time)
        if values is None:
            return None
        if not hasattr(values, "__len__") or (columns > 1 and len(values) and not hasattr(values[0], "__len__")):
            values = [values]
        found = numpy.asarray(values, "f4")
        if not found.size or found.size % columns:
            return None
        return found.reshape(-1, columns), str(primvar.GetInterpolation())

    def colour(self, result: Geometry) -> tuple[numpy.ndarray, str] | None:
        """Sets the colour and the opacity of the whole prim; returns colours that differ within it."""
        opacity = self.find("displayOpacity", 1)
        if opacity is not None and numpy.isfinite(opacity[0]).all():
            result.opacity = float(opacity[0].mean())
        found = self.find("displayColor", 3)
        if found is None:
            return None
        if len(found[0]) == 1 or found[1] == UsdGeom.Tokens.constant:
            if numpy.isfinite(found[0][0]).all():
                result.colour = found[0][0].tolist()
            return None
        return found

    def uvs(self) -> tuple[numpy.ndarray, str] | None:
        if not self._exist:
            return None
        names = [one.GetPrimvarName() for one in self.api.FindPrimvarsWithInheritance()
                 if one.GetTypeName().role == Sdf.ValueRoleNames.TextureCoordinate or
                 one.GetTypeName().scalarType == Sdf.ValueTypeNames.Float2]
        for name in sorted(names, key=lambda one: (one not in ("st", "UVMap", "st0", "map1"), one)):
            found = self.find(name, 2) if "3" not in str(self.api.GetPrimvar(name).GetTypeName()) else None
            if found is not None:
                return found
        return None


def colour(prim: Usd.Prim, time: Usd.TimeCode) -> tuple[list[float], float | None] | None:
    """The colour and the opacity of a whole prim; None without a colour, and if it differs within the prim."""
    result = Geometry()
    if _Primvars(prim, time).colour(result) is not None or result.colour is None:
        return None
    return result.colour, result.opacity


def _mesh(prim: Usd.Prim, time: Usd.TimeCode, result: Geometry, primvars: _Primvars, points=None) -> None:
    mesh = UsdGeom.Mesh(prim)
    positions = array(mesh.GetPointsAttr().Get(time) if points is None else points, 3)
    counts = array(mesh.GetFaceVertexCountsAttr().Get(time), 0, "i8")
    indices = array(mesh.GetFaceVertexIndicesAttr().Get(time), 0, "i8")
    _bounded(max(len(positions), len(indices)))
    if not len(positions) or not len(counts):
        return
    left_handed = mesh.GetOrientationAttr().Get(time) == UsdGeom.Tokens.leftHanded
    faces = shapes.triangulated(counts, indices, positions, array(mesh.GetHoleIndicesAttr().Get(time), 0, "i8"), left_handed)
    result.problem = faces.problem
    smooth = mesh.GetSubdivisionSchemeAttr().Get(time) != UsdGeom.Tokens.none
    values: dict[str, tuple[numpy.ndarray, str]] = {}
    if not smooth:
        found = primvars.find("normals", 3)
        if found is None:
            own = array(mesh.GetNormalsAttr().Get(time) if points is None else None, 3)
            found = (own, str(mesh.GetNormalsInterpolation())) if len(own) else None
        if found is not None:
            values["normals"] = found
    for name, found in (("uvs", primvars.uvs()), ("colours", primvars.colour(result))):
        if found is not None:
            values[name] = found
    _subsets(mesh, faces, time, result)
    expanded = any(kind in (UsdGeom.Tokens.faceVarying, UsdGeom.Tokens.uniform) for _, kind in values.values())
    drawn = indices[faces.corners]
    shape = Shape(wire.MESH, positions[drawn] if expanded else positions,
                  numpy.arange(len(drawn)) if expanded else drawn, faces=faces.of, smooth=smooth)
    for name, (found, kind) in values.items():
        if kind == UsdGeom.Tokens.faceVarying:
            wanted, place = len(indices), faces.corners
        elif kind == UsdGeom.Tokens.uniform:
            wanted, place = len(counts), numpy.repeat(faces.of, 3)
        elif kind == UsdGeom.Tokens.constant:
            wanted, place = 1, numpy.zeros(len(shape.points), numpy.int64)
        else:
            wanted, place = len(positions), drawn if expanded else None
        if len(found) < wanted:
            result.problem = result.problem or f"there are {len(found)} {name}, and {wanted} are needed"
            continue
        setattr(shape, name, found[:wanted] if place is None else found[place])
    result.shape = shape


def _subsets(mesh: UsdGeom.Mesh, faces: shapes.Faces, time: Usd.TimeCode, result: Geometry) -> None:
    """Sorts the triangles by the subsets with materials."""
    subsets = [one for one in UsdGeom.Subset.GetAllGeomSubsets(mesh)
               if one.GetElementTypeAttr().Get(time) == UsdGeom.Tokens.face and one.GetFamilyNameAttr().Get(time) == "materialBind"]
    if not subsets or not len(faces.of):
        return
    most = int(faces.of.max()) + 1
    group = numpy.full(most, len(subsets))
    for number, subset in enumerate(subsets):
        indices = array(subset.GetIndicesAttr().Get(time), 0, "i8")
        group[indices[(indices >= 0) & (indices < most)]] = number
    of = group[faces.of]
    order = numpy.argsort(of, kind="stable")
    faces.corners = faces.corners.reshape(-1, 3)[order].reshape(-1)
    faces.of = faces.of[order]
    bounds = numpy.searchsorted(of[order], numpy.arange(len(subsets) + 1))
    for number, subset in enumerate(subsets):
        first, count = int(bounds[number]) * 3, int(bounds[number + 1] - bounds[number]) * 3
        if count:
            result.subsets.append((str(subset.GetPath()), first, count))


def _tet_mesh(prim: Usd.Prim, time: Usd.TimeCode, result: Geometry, primvars: _Primvars, points=None) -> None:
    mesh = UsdGeom.TetMesh(prim)
    positions = array(mesh.GetPointsAttr().Get(time), 3)
    surface = array(mesh.GetSurfaceFaceVertexIndicesAttr().Get(time), 3, "i8")
    if not len(surface):
        tets = array(mesh.GetTetVertexIndicesAttr().Get(time), 4, "i8")
        sides = numpy.concatenate([tets[:, side] for side in ([1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1])])
        key = numpy.sort(sides, axis=1)
        _, first, number = numpy.unique(key, axis=0, return_index=True, return_counts=True)
        surface = sides[first[number == 1]]
    faces = shapes.triangulated(numpy.full(len(surface), 3), surface.reshape(-1), positions, numpy.zeros(0, "i8"),
                                mesh.GetOrientationAttr().Get(time) == UsdGeom.Tokens.leftHanded)
    result.problem = faces.problem
    primvars.colour(result)
    result.shape = Shape(wire.MESH, positions, surface.reshape(-1)[faces.corners], faces=faces.of)


def _of_points(result: Geometry, primvars: _Primvars, shape: Shape, chosen: numpy.ndarray | None = None) -> None:
    colours = primvars.colour(result)
    if colours is not None:
        if chosen is not None and len(colours[0]) > int(chosen.max(initial=-1)):
            shape.colours = colours[0][chosen]
        elif chosen is None and len(colours[0]) == len(shape.points):
            shape.colours = colours[0]
    result.shape = shape


def _points(prim: Usd.Prim, time: Usd.TimeCode, result: Geometry, primvars: _Primvars, points=None) -> None:
    cloud = UsdGeom.Points(prim)
    positions = array(cloud.GetPointsAttr().Get(time), 3)
    _bounded(len(positions))
    finite = numpy.isfinite(positions).all(axis=1)
    if not finite.all():
        result.problem = f"{int((~finite).sum())} points are not finite"
    chosen = None if finite.all() else numpy.flatnonzero(finite)
    widths = array(cloud.GetWidthsAttr().Get(time))
    if len(widths) == 1:
        widths = numpy.repeat(widths, len(positions))
    kept = positions if chosen is None else positions[chosen]
    widths = None if len(widths) != len(positions) else widths if chosen is None else widths[chosen]
    _of_points(result, primvars, Shape(wire.POINTS, kept, widths=widths), chosen)


def _curves(prim: Usd.Prim, time: Usd.TimeCode, result: Geometry, primvars: _Primvars, points=None) -> None:
    curves = UsdGeom.Curves(prim)
    positions = array(curves.GetPointsAttr().Get(time), 3)
    counts = array(curves.GetCurveVertexCountsAttr().Get(time), 0, "i8")
    _bounded(len(positions))
    if len(counts) and (counts.min() < 0 or counts.sum() > len(positions)):
        raise ValueError(f"the curves have {int(counts.sum())} points, and there are {len(positions)}")
    positions = positions[:int(counts.sum())]
    basis = UsdGeom.BasisCurves(prim)
    cubic = bool(basis) and basis.GetTypeAttr().Get(time) == UsdGeom.Tokens.cubic
    wrap = basis.GetWrapAttr().Get(time) if basis else UsdGeom.Tokens.nonperiodic
    closed = wrap == UsdGeom.Tokens.periodic
    if cubic:
        positions, counts = _cubic(positions, counts, basis.GetBasisAttr().Get(time), wrap)
        closed = False
        primvars.colour(result)
        result.shape = Shape(wire.CURVES, positions, shapes.lines(counts, False))
        return
    _of_points(result, primvars, Shape(wire.CURVES, positions, shapes.lines(counts, closed)))


_STEPS = 8  # lines for each segment of a cubic curve
_BASES = {
    "bezier": ((-1, 3, -3, 1), (3, -6, 3, 0), (-3, 3, 0, 0), (1, 0, 0, 0)),
    "bspline": ((-1 / 6, 3 / 6, -3 / 6, 1 / 6), (3 / 6, -1, 3 / 6, 0), (-3 / 6, 0, 3 / 6, 0), (1 / 6, 4 / 6, 1 / 6, 0)),
    "catmullRom": ((-0.5, 1.5, -1.5, 0.5), (1, -2.5, 2, -0.5), (-0.5, 0, 0.5, 0), (0, 1, 0, 0)),
}


def _cubic(points: numpy.ndarray, counts: numpy.ndarray, basis: str, wrap: str) -> tuple[numpy.ndarray, numpy.ndarray]:
    """The points of cubic curves, as linear ones."""
    step = 3 if basis == "bezier" else 1
    at = numpy.linspace(0, 1, _STEPS, endpoint=False)
    weights = numpy.stack([at ** 3, at ** 2, at, numpy.ones_like(at)], axis=1) @ numpy.array(_BASES.get(basis, _BASES["bezier"]))
    last = numpy.array([[1, 1, 1, 1]]) @ numpy.array(_BASES.get(basis, _BASES["bezier"]))
    parts, numbers, start = [], [], 0
    for count in counts.tolist():
        curve = points[start:start + count]
        start += count
        if wrap == UsdGeom.Tokens.periodic and count:
            curve = numpy.concatenate([curve, curve[:1 if step == 3 else 3]])
        elif wrap == UsdGeom.Tokens.pinned and step == 1 and count >= 2:
            curve = numpy.concatenate([[2 * curve[0] - curve[1]], curve, [2 * curve[-1] - curve[-2]]])
        segments = (len(curve) - 4) // step + 1 if len(curve) >= 4 else 0
        if segments <= 0:
            continue
        first = numpy.arange(segments) * step
        control = numpy.stack([curve[first + one] for one in range(4)], axis=1)
        made = numpy.einsum("ki,sic->skc", weights, control).reshape(-1, 3)
        parts += [made, last @ control[-1]]
        numbers.append(len(made) + 1)
    if not parts:
        return numpy.zeros((0, 3)), numpy.zeros(0, numpy.int64)
    return numpy.concatenate(parts), numpy.array(numbers)


def _gprim(make: typing.Callable[..., Shape], *names: tuple[str, typing.Any]) -> typing.Callable[..., None]:
    made = functools.lru_cache(256)(make)  # many prims have the same numbers

    def read_it(prim: Usd.Prim, time: Usd.TimeCode, result: Geometry, primvars: _Primvars, points=None) -> None:
        primvars.colour(result)
        values = [value(prim, name, time, default) for name, default in names]
        result.shape = made(*(str(one) if isinstance(one, str) else float(one) for one in values))
    return read_it


def _unsupported(prim: Usd.Prim, time: Usd.TimeCode, result: Geometry, primvars: _Primvars, points=None) -> None:
    result.problem = f"a {prim.GetTypeName()} is not drawn"


_AXIS = ("axis", "Z")
_READERS: dict[str, typing.Callable[..., None]] = {
    "Mesh": _mesh, "TetMesh": _tet_mesh, "Points": _points, "BasisCurves": _curves, "NurbsCurves": _curves,
    "HermiteCurves": _curves,
    "Cube": _gprim(gprims.cube, ("size", 2.0)), "Sphere": _gprim(gprims.sphere, ("radius", 1.0)),
    "Cylinder": _gprim(lambda radius, height, axis: gprims.cylinder(radius, radius, height, axis), ("radius", 1.0),
                       ("height", 2.0), _AXIS),
    "Cylinder_1": _gprim(gprims.cylinder, ("radiusBottom", 1.0), ("radiusTop", 1.0), ("height", 2.0), _AXIS),
    "Cone": _gprim(lambda radius, height, axis: gprims.cylinder(radius, 0.0, height, axis), ("radius", 1.0), ("height", 2.0), _AXIS),
    "Capsule": _gprim(lambda radius, height, axis: gprims.capsule(radius, radius, height, axis), ("radius", 0.5), ("height", 1.0),
                      _AXIS),
    "Capsule_1": _gprim(gprims.capsule, ("radiusBottom", 0.5), ("radiusTop", 0.5), ("height", 1.0), _AXIS),
    "Plane": _gprim(gprims.plane, ("width", 2.0), ("length", 2.0), _AXIS),
}


def _reader_of(prim: Usd.Prim) -> typing.Callable[..., None]:
    """For types of plug-ins, which derive from a known one."""
    for schema, name in ((UsdGeom.Mesh, "Mesh"), (UsdGeom.Points, "Points"), (UsdGeom.Curves, "BasisCurves"),
                         (UsdGeom.Cube, "Cube"), (UsdGeom.Sphere, "Sphere")):
        if prim.IsA(schema):
            return _READERS[name]
    return _unsupported


def kind_of(prim: Usd.Prim) -> str:
    """The kind of the item for a gprim."""
    if prim.IsA(UsdGeom.Curves):
        return "curves"
    return "points" if prim.IsA(UsdGeom.Points) else "mesh"
