"""Answers of the tree of prims: children, search, bounds. On the thread of the stage."""

from __future__ import annotations

import math
import typing

import usdlive
from pxr import Sdf, Usd, UsdGeom

MOST_CHILDREN = 1000
MOST_FOUND = 500
_ALL = Usd.TraverseInstanceProxies(Usd.PrimAllPrimsPredicate)


def prim_at(stage: Usd.Stage, path: object) -> Usd.Prim:
    if not isinstance(path, str) or not Sdf.Path.IsValidPathString(path):
        raise usdlive.Error("invalidPath", f"{path!r} is no path of a prim")
    prim = stage.GetPrimAtPath(path) if path == "/" else stage.GetPrimAtPath(Sdf.Path(path).GetPrimPath())
    if not prim:
        raise usdlive.Error("NotFound", f"there is no prim {path}")
    return prim


def _entry(prim: Usd.Prim) -> dict:
    specifier = {Sdf.SpecifierDef: "def", Sdf.SpecifierOver: "over", Sdf.SpecifierClass: "class"}
    return {"path": str(prim.GetPath()), "name": prim.GetName(), "type": str(prim.GetTypeName()),
            "kind": str(Usd.ModelAPI(prim).GetKind()) if not prim.IsPseudoRoot() else "",
            "children": len(prim.GetFilteredChildren(_ALL)), "active": prim.IsActive(), "loaded": prim.IsLoaded(),
            "instance": prim.IsInstance(), "specifier": specifier.get(prim.GetSpecifier(), "over"),
            "hasVariants": prim.HasVariantSets()}


def children(stage: Usd.Stage, path: str, first: int, count: int) -> dict:
    found = prim_at(stage, path).GetFilteredChildren(_ALL)
    first = max(0, first)
    return {"total": len(found), "items": [_entry(one) for one in found[first:first + max(0, min(count, MOST_CHILDREN))]]}


def search(stage: Usd.Stage, paths: typing.Iterable[str], text: str, limit: int) -> dict:
    """Those of `paths` whose name has the text, or the path if there is a slash in it, in the order of the stage."""
    wanted, limit = text.lower(), max(1, min(limit, MOST_FOUND))
    found: list[dict] = []
    for path in paths:
        if wanted in (path if "/" in wanted else path[path.rfind("/") + 1:]).lower():
            prim = stage.GetPrimAtPath(path)
            if not prim:
                continue
            if len(found) == limit:
                return {"items": found, "more": True}
            found.append(_entry(prim))
    return {"items": found, "more": False}


def bounds(stage: Usd.Stage, paths: list[str], time: Usd.TimeCode) -> dict:
    """The boxes of prims in the world, as UsdGeom computes them; null without one."""
    cache = UsdGeom.BBoxCache(time, [UsdGeom.Tokens.default_, UsdGeom.Tokens.render, UsdGeom.Tokens.proxy])
    boxes: dict[str, object] = {}
    for path in paths[:256]:
        box = cache.ComputeWorldBound(prim_at(stage, path)).ComputeAlignedRange()
        corners = [*box.GetMin(), *box.GetMax()]
        boxes[path] = None if box.IsEmpty() or not all(map(math.isfinite, corners)) else \
            {"min": corners[:3], "max": corners[3:]}
    return {"boxes": boxes}
