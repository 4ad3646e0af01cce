"""Checks the xformOps that the page and the adapter write for a matrix."""

import random

import pytest
import usdlive
from pxr import Gf, Usd, UsdGeom
from usdlive._transforms import ops_for

KINDS = {"translate": UsdGeom.XformOp.TypeTranslate, "scale": UsdGeom.XformOp.TypeScale, "orient": UsdGeom.XformOp.TypeOrient,
         "transform": UsdGeom.XformOp.TypeTransform,
         **{f"rotate{order}": getattr(UsdGeom.XformOp, f"TypeRotate{order}") for order in ("XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX", "X", "Y", "Z")}}
STACKS = [[], ["transform"], ["translate", "orient", "scale"], *[["translate", f"rotate{order}", "scale"] for order in
          ("XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX")], ["translate", "pivot", "rotateXYZ", "scale", "unpivot"]]


def prim_with(stack, stage) -> Usd.Prim:
    xform = UsdGeom.Xform.Define(stage, "/A")
    for kind in stack:
        if kind in ("pivot", "unpivot"):
            op = xform.AddXformOp(UsdGeom.XformOp.TypeTranslate, UsdGeom.XformOp.PrecisionFloat, "pivot", kind == "unpivot")
            kind == "pivot" and op.Set(Gf.Vec3f(1, 2, 3))
        else:
            precision = UsdGeom.XformOp.PrecisionDouble
            xform.AddXformOp(KINDS[kind], precision)
    return xform.GetPrim()


def write(prim, found) -> None:
    for one in found:
        (prim.GetAttribute(one.name) or prim.CreateAttribute(one.name, one.type)).Set(one.value)


@pytest.mark.parametrize("stack", STACKS, ids="+".join)
def test_a_prim_gets_the_matrix_by_its_ops(stack):
    for seed in range(50):
        rng = random.Random(seed)
        stage = Usd.Stage.CreateInMemory()
        prim = prim_with(stack, stage)
        turn = Gf.Rotation(Gf.Vec3d(*[rng.uniform(-1, 1) for _ in range(3)]), rng.uniform(-180, 180))
        wanted = Gf.Matrix4d().SetScale(Gf.Vec3d(*[rng.uniform(0.5, 2) for _ in range(3)])) * Gf.Matrix4d().SetRotate(turn)
        wanted.SetTranslateOnly(Gf.Vec3d(*[rng.uniform(-10, 10) for _ in range(3)]))
        write(prim, ops_for(prim, wanted, Usd.TimeCode.Default()))
        assert Gf.IsClose(UsdGeom.Xformable(prim).GetLocalTransformation(), wanted, 1e-4), seed


def test_what_the_ops_cannot_reach_is_an_error():
    stage = Usd.Stage.CreateInMemory()
    moved = prim_with(["translate"], stage)
    write(moved, ops_for(moved, Gf.Matrix4d().SetTranslate(Gf.Vec3d(1, 2, 3)), Usd.TimeCode.Default()))
    assert moved.GetAttribute("xformOp:translate").Get() == (1, 2, 3)
    with pytest.raises(usdlive.Error, match="no xformOp for this change"):
        ops_for(moved, Gf.Matrix4d().SetScale(2), Usd.TimeCode.Default())
    other = Usd.Stage.CreateInMemory()
    odd = prim_with(["scale", "translate"], other)
    with pytest.raises(usdlive.Error, match="cannot be moved here"):
        ops_for(odd, Gf.Matrix4d(1), Usd.TimeCode.Default())
