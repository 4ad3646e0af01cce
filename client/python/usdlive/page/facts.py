"""Reads cameras and lights. On the thread of the stage."""

from __future__ import annotations

import math
import typing

from pxr import Sdf, Usd, UsdGeom, UsdLux

_LIGHTS = {"DistantLight": "distant", "SphereLight": "sphere", "RectLight": "rect", "DiskLight": "disk", "DomeLight": "dome",
           "DomeLight_1": "dome", "CylinderLight": "cylinder"}


def _read(prim: Usd.Prim, name: str, time: Usd.TimeCode, default: float) -> float:
    value = prim.GetAttribute(name).Get(time)
    return float(value) if isinstance(value, (int, float)) and math.isfinite(value) else default


def camera(prim: Usd.Prim, time: Usd.TimeCode) -> dict:
    clipping = prim.GetAttribute("clippingRange").Get(time) or (1.0, 1_000_000.0)
    orthographic = prim.GetAttribute("projection").Get(time) == UsdGeom.Tokens.orthographic
    near, far = (float(one) if math.isfinite(one) else default for one, default in zip(clipping, (1.0, 1e6)))
    return {"focal": _read(prim, "focalLength", time, 50.0), "hAperture": _read(prim, "horizontalAperture", time, 20.955),
            "vAperture": _read(prim, "verticalAperture", time, 15.2908), "near": near, "far": far,
            "projection": "orthographic" if orthographic else "perspective",
            "hOffset": _read(prim, "horizontalApertureOffset", time, 0.0),
            "vOffset": _read(prim, "verticalApertureOffset", time, 0.0)}


def is_light(prim: Usd.Prim) -> bool:
    return prim.HasAPI(UsdLux.LightAPI)


def light(prim: Usd.Prim, time: Usd.TimeCode) -> tuple[dict, Sdf.AssetPath | None]:
    """The light, and the file of its texture."""
    colour = prim.GetAttribute("inputs:color").Get(time)
    found: dict[str, typing.Any] = {
        "type": _LIGHTS.get(prim.GetTypeName(), "sphere"),
        "color": [float(one) if math.isfinite(one) else 1.0 for one in colour] if colour is not None else [1.0, 1.0, 1.0],
        "intensity": _read(prim, "inputs:intensity", time, 1.0), "exposure": _read(prim, "inputs:exposure", time, 0.0),
        "radius": _read(prim, "inputs:radius", time, 0.5), "width": _read(prim, "inputs:width", time, 1.0),
        "height": _read(prim, "inputs:height", time, 1.0), "length": _read(prim, "inputs:length", time, 1.0),
        "angle": _read(prim, "inputs:angle", time, 0.53), "texture": ""}
    file = prim.GetAttribute("inputs:texture:file")
    asset = file.Get(time) if file else None
    return found, asset if asset else None
