"""Finds values for the xformOps of a prim that give it a local matrix. On the thread of the stage."""

from __future__ import annotations

import typing

from pxr import Gf, Sdf, Usd, UsdGeom

from ._errors import Error

_AXES = {"X": Gf.Vec3d(1, 0, 0), "Y": Gf.Vec3d(0, 1, 0), "Z": Gf.Vec3d(0, 0, 1)}
_TYPES = {"translate": Sdf.ValueTypeNames.Double3, "rotateXYZ": Sdf.ValueTypeNames.Float3, "scale": Sdf.ValueTypeNames.Float3}


class OpValue(typing.NamedTuple):
    """The value of an attribute of the prim. `time`: None for the default."""

    name: str
    type: Sdf.ValueTypeName
    value: typing.Any
    is_uniform: bool = False


def _parts(matrix: Gf.Matrix4d) -> tuple[Gf.Vec3d, Gf.Matrix4d, Gf.Vec3d]:
    """Translation, rotation and scale. A shear is lost."""
    rows = [Gf.Vec3d(*[matrix[row][column] for column in range(3)]) for row in range(3)]
    scale = Gf.Vec3d(*[row.GetLength() for row in rows])
    if matrix.GetDeterminant3() < 0:
        scale[0] = -scale[0]
    rotation = Gf.Matrix4d(1)
    for place, row in enumerate(rows):
        if scale[place]:
            rotation.SetRow3(place, row / scale[place])
    return matrix.ExtractTranslation(), rotation.GetOrthonormalized(False), scale


def _angles(rotation: Gf.Matrix4d, order: str) -> list[float]:
    """Angles around the axes of rotateXYZ and its like, in degrees."""
    found = rotation.ExtractRotation().Decompose(*[_AXES[axis] for axis in reversed(order)])
    by_axis = dict(zip(reversed(order), found))
    return [by_axis[axis] for axis in "XYZ"]


def ops_for(prim: Usd.Prim, matrix: Gf.Matrix4d, time: Usd.TimeCode) -> list[OpValue]:
    """The attributes to write. Raises an Error if the prim has ops with which the matrix cannot be reached."""
    xformable = UsdGeom.Xformable(prim)
    if not xformable:
        raise Error("invalidArgument", f"{prim.GetPath()} cannot be moved: a {prim.GetTypeName() or 'prim without a type'} "
                            "has no transform")
    ops = xformable.GetOrderedXformOps()
    if len(ops) == 1 and ops[0].GetOpType() == UsdGeom.XformOp.TypeTransform and not ops[0].IsInverseOp():
        kind = ops[0].GetAttr().GetTypeName()
        return [OpValue(ops[0].GetName(), kind, kind.type.pythonClass(matrix))]
    translation, rotation, scale = _parts(matrix)
    if not ops:
        reset = ["!resetXformStack!"] if xformable.GetResetXformStack() else []
        names = ["xformOp:translate", "xformOp:rotateXYZ", "xformOp:scale"]
        return [OpValue(names[0], _TYPES["translate"], translation), OpValue(names[1], _TYPES["rotateXYZ"], Gf.Vec3f(*_angles(rotation, "XYZ"))),
                OpValue(names[2], _TYPES["scale"], Gf.Vec3f(scale)),
                OpValue("xformOpOrder", Sdf.ValueTypeNames.TokenArray, reset + names, True)]
    return _into(prim, ops, matrix, translation, rotation, scale, time)


def _into(prim: Usd.Prim, ops: list[UsdGeom.XformOp], matrix: Gf.Matrix4d, translation: Gf.Vec3d, rotation: Gf.Matrix4d,
          scale: Gf.Vec3d, time: Usd.TimeCode) -> list[OpValue]:
    """Writes into ops that are there: translate, a pivot, one rotation, one scale, in this order."""
    kinds = {UsdGeom.XformOp.TypeTranslate: "translate", UsdGeom.XformOp.TypeScale: "scale", UsdGeom.XformOp.TypeOrient: "orient"}
    steps: list[tuple[str, UsdGeom.XformOp]] = []
    for op in ops:
        kind = kinds.get(op.GetOpType(), "")
        order = str(op.GetOpType()).rsplit("Rotate", 1)[-1] if "Rotate" in str(op.GetOpType()) else ""
        is_pivot = kind == "translate" and op.GetOpName().endswith(":pivot")
        steps.append(("unpivot" if is_pivot and op.IsInverseOp() else "pivot" if is_pivot else kind or (f"rotate{order}" if order else ""), op))
    names = [name for name, _ in steps]
    shape = [one for one in ("translate", "pivot", "rotation", "scale", "unpivot")
             if any(name == one or (one == "rotation" and (name.startswith("rotate") or name == "orient")) for name in names)]
    plain = ["rotation" if name.startswith("rotate") or name == "orient" else name for name in names]
    if plain != shape or ("pivot" in names) != ("unpivot" in names) or any(op.IsInverseOp() for name, op in steps if name != "unpivot"):
        raise Error("invalidArgument", f"{prim.GetPath()} cannot be moved here: its xformOps are {', '.join(op.GetOpName() for op in ops)}")
    pivot = Gf.Vec3d(*next((op.Get(time) for name, op in steps if name == "pivot"), (0, 0, 0)) or (0, 0, 0))
    linear = Gf.Matrix4d().SetScale(scale) * rotation
    found: list[OpValue] = []
    for name, op in steps:
        kind = op.GetAttr().GetTypeName()
        made = kind.type.pythonClass
        if name == "translate":
            found.append(OpValue(op.GetName(), kind, made(*(translation - pivot + linear.TransformDir(pivot)))))
        elif name == "scale":
            found.append(OpValue(op.GetName(), kind, made(*scale)))
        elif name == "orient":
            quaternion = rotation.ExtractRotationQuat()
            found.append(OpValue(op.GetName(), kind, made(quaternion.GetReal(), *quaternion.GetImaginary())))
        elif name in ("rotateX", "rotateY", "rotateZ"):
            angle = _angles(rotation, name[-1] + "".join(sorted({"X", "Y", "Z"} - {name[-1]})))["XYZ".index(name[-1])]
            found.append(OpValue(op.GetName(), kind, angle))
        elif name.startswith("rotate"):
            found.append(OpValue(op.GetName(), kind, made(*_angles(rotation, name[len("rotate"):]))))
    _check(prim, steps, found, matrix, pivot)
    return found


def _check(prim: Usd.Prim, steps: list[tuple[str, UsdGeom.XformOp]], found: list[OpValue], matrix: Gf.Matrix4d, pivot: Gf.Vec3d) -> None:
    """Raises an Error if the ops lack one that the matrix needs."""
    stage = Usd.Stage.CreateInMemory()
    copy = UsdGeom.Xformable(stage.DefinePrim("/A", "Xform"))
    values = {one.name: one.value for one in found}
    order = []
    for name, op in steps:
        attribute = copy.GetPrim().CreateAttribute(op.GetName().removeprefix("!invert!"), op.GetAttr().GetTypeName())
        if name == "pivot":
            attribute.Set(op.GetAttr().GetTypeName().type.pythonClass(*pivot))
        elif name != "unpivot":
            attribute.Set(values[op.GetName()])
        order.append(op.GetOpName())
    copy.GetXformOpOrderAttr().Set(order)
    if not Gf.IsClose(copy.GetLocalTransformation(), matrix, 1e-3 * max(1.0, *(abs(matrix[row][column]) for row in range(4) for column in range(4)))):
        raise Error("invalidArgument", f"{prim.GetPath()} has no xformOp for this change: it has {', '.join(order)}")
