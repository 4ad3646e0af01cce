"""Skins meshes on the CPU with UsdSkel. On the thread of the stage."""

from __future__ import annotations

import typing

import numpy
from pxr import Gf, Usd, UsdGeom, UsdSkel, Vt


class Skinned(typing.NamedTuple):
    """`depends`: paths of prims whose changes move the mesh. `animated`: it differs between times."""

    points: Vt.Vec3fArray | None
    depends: tuple[str, ...]
    animated: bool
    problem: str


class Skins:
    """Knows the skeletons of a stage. `forget()` when prims or bindings change."""

    def __init__(self) -> None:
        self._cache = UsdSkel.Cache()
        self._populated: set[str] = set()

    def forget(self) -> None:
        self._cache.Clear()
        self._populated.clear()

    def points(self, prim: Usd.Prim, time: Usd.TimeCode) -> Skinned | None:
        """The points of a mesh as its skeleton moves them, in the space of the mesh; None if it has no skeleton."""
        root = _root_of(prim)
        if not root:
            return None
        path = str(root.GetPath())
        if path not in self._populated:
            self._cache.Populate(root, Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate))
            self._populated.add(path)
        query = self._cache.GetSkinningQuery(prim)
        if not query or not (query.HasJointInfluences() or query.HasBlendShapes()):
            return None
        skeleton = UsdSkel.BindingAPI(prim).GetInheritedSkeleton()
        if not skeleton:
            return None
        skeleton_query = self._cache.GetSkelQuery(skeleton)
        if not skeleton_query:
            return Skinned(None, (), False, f"the skeleton {skeleton.GetPath()} cannot be read")
        animation = skeleton_query.GetAnimQuery()
        depends = [str(skeleton.GetPath())] + ([str(animation.GetPrim().GetPath())] if animation else [])
        animated = bool(animation) and (animation.JointTransformsMightBeTimeVarying() or
                                        animation.BlendShapeWeightsMightBeTimeVarying())
        points = UsdGeom.PointBased(prim).GetPointsAttr().Get(time)
        if not points:
            return None
        if query.HasBlendShapes() and animation:
            points = self._shaped(query, animation, prim, time, points)
        if not query.HasJointInfluences():
            return Skinned(points, tuple(depends), animated, "")
        transforms = skeleton_query.ComputeSkinningTransforms(time)
        if not transforms or not query.ComputeSkinnedPoints(transforms, points, time):
            return Skinned(None, tuple(depends), animated, f"the mesh cannot be skinned by {skeleton.GetPath()}")
        cache = UsdGeom.XformCache(time)
        to_mesh = cache.GetLocalToWorldTransform(skeleton.GetPrim()) * cache.GetLocalToWorldTransform(prim).GetInverse()
        if to_mesh != Gf.Matrix4d(1):
            moved = numpy.asarray(points, "f8") @ numpy.array(to_mesh)[:3, :3] + numpy.array(to_mesh)[3, :3]
            points = Vt.Vec3fArray.FromNumpy(moved.astype("f4"))
        return Skinned(points, tuple(depends), animated, "")

    def _shaped(self, query: UsdSkel.SkinningQuery, animation: UsdSkel.AnimQuery, prim: Usd.Prim, time: Usd.TimeCode,
                points: Vt.Vec3fArray) -> Vt.Vec3fArray:
        """Adds the blend shapes by the weights of the animation."""
        weights = animation.ComputeBlendShapeWeights(time)
        mapper = query.GetBlendShapeMapper()
        if weights is None or not mapper:
            return points
        weights = mapper.Remap(weights)
        shapes = UsdSkel.BlendShapeQuery(UsdSkel.BindingAPI(prim))
        computed = shapes.ComputeSubShapeWeights(weights)
        if not computed:
            return points
        sub_weights, sub_indices, sub_shapes = computed
        result = Vt.Vec3fArray(points)
        shapes.ComputeDeformedPoints(sub_weights, sub_indices, sub_shapes, shapes.ComputeBlendShapePointIndices(),
                                     shapes.ComputeSubShapePointOffsets(), result)
        return result


def _root_of(prim: Usd.Prim) -> UsdSkel.Root | None:
    while prim and not prim.IsPseudoRoot():
        if prim.IsA(UsdSkel.Root):
            return UsdSkel.Root(prim)
        prim = prim.GetParent()
    return None
