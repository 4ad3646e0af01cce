"""Compares what the gateway of the page reads from stages with UsdGeom."""

import shutil

import numpy
from pxr import Gf, Usd, UsdGeom
from stages_test import STAGES

EVERYTHING = Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)


def box_of(points) -> Gf.Range3d:
    box = Gf.Range3d()
    for point in (points.min(axis=0), points.max(axis=0)) if len(points) else ():
        box.UnionWith(Gf.Vec3d(*map(float, point)))
    return box


def is_near(one: Gf.Range3d, other: Gf.Range3d) -> bool:
    if one.IsEmpty() or other.IsEmpty():
        return one.IsEmpty() == other.IsEmpty()
    size = max(1e-6, *map(abs, [*other.GetMin(), *other.GetMax()]))
    return all(Gf.IsClose(a, b, 1e-4 * size) for a, b in ((one.GetMin(), other.GetMin()), (one.GetMax(), other.GetMax())))


def compare(page, stage: Usd.Stage, time=Usd.TimeCode.Default()) -> int:
    """Checks the matrices, the visibility and the boxes of all items of a page. Returns how many boxes it has compared."""
    xforms = UsdGeom.XformCache(time)
    boxes = UsdGeom.BBoxCache(time, ["default", "render", "proxy", "guide"], False, True)
    items = {item["path"]: item for item in page.items.values()}
    compared = 0
    for prim in Usd.PrimRange(stage.GetPseudoRoot(), EVERYTHING):
        path = str(prim.GetPath())
        if not prim.IsA(UsdGeom.Imageable) or prim.IsA(UsdGeom.Subset):
            assert path not in items
            continue
        item = items.pop(path)
        world = xforms.GetLocalToWorldTransform(prim)
        assert numpy.allclose(page.world(item), numpy.array(world), rtol=1e-5, atol=1e-6 * max(1, abs(numpy.array(world)).max())), path
        assert page.is_visible(item) == (UsdGeom.Imageable(prim).ComputeVisibility(time) != "invisible"), path
        assert item["purpose"] == UsdGeom.Imageable(prim).ComputePurpose(), path
        if not prim.IsA(UsdGeom.Gprim) or "problem" in item:
            continue
        extent = UsdGeom.Boundable.ComputeExtentFromPlugins(UsdGeom.Boundable(prim), time)
        if extent is None or not len(extent):
            continue
        points = page.geometry(item)["positions"] if "geometry" in item else numpy.zeros((0, 3))
        own = box_of(points)
        if item["kind"] == "mesh":
            assert is_near(own, Gf.Range3d(*map(Gf.Vec3d, extent))), (path, own, extent)
        authored = UsdGeom.Boundable(prim).GetExtentAttr().Get(time)
        if item["kind"] == "mesh" and (authored is None or is_near(Gf.Range3d(*map(Gf.Vec3d, authored)), own)):
            mine = Gf.BBox3d(own, Gf.Matrix4d(page.world(item).tolist())).ComputeAlignedRange()
            if (UsdGeom.Imageable(prim).ComputeVisibility(time) != "invisible"):
                assert is_near(mine, boxes.ComputeWorldBound(prim).ComputeAlignedRange()), path
                compared += 1
    assert not items, list(items)[:5]
    return compared


def test_newton_stages_are_read_as_usdgeom_reads_them(project, serve, gateway, page):
    names = [f"{stage.parts[-3]}/{stage.name}" for stage in STAGES]
    for stage, name in zip(STAGES, names):
        (project / name).parent.mkdir(exist_ok=True)
        shutil.copy(stage, project / name)
    one = page(gateway(serve(project), "--stage", names[0]))
    compared = 0
    for name in names:
        if name != names[0]:
            one.complete = False
            one.messages.pop("state", None)
            one.ask("stage", layer=name)
            one.opened()
        assert one.messages["welcome"]["stage"] == name
        compared += compare(one, Usd.Stage.Open(str(project / name)))
    assert compared > 200
