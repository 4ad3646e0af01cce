"""Compares the values of attributes that the C++ client resolves with those of pxr.Usd, on random stages."""

import os
import pathlib
import subprocess

import pytest
from pxr import Sdf, Usd, Vt
from value_stages import RandomStage

PROBE = pathlib.Path(os.environ["USDLIVE_BUILD"]) / "bin" / "stage_probe"
TIMES = [-30.0, -3.0, 0.0, 0.25, 0.9999999, 1.0, 1.75, 2.0, 4.5, 7.0, 10.0, 12.5, 31.0, 100.0]
SOURCES = {
    Usd.ResolveInfoSourceNone: "none",
    Usd.ResolveInfoSourceFallback: "fallback",
    Usd.ResolveInfoSourceDefault: "default",
    Usd.ResolveInfoSourceTimeSamples: "timeSamples",
    Usd.ResolveInfoSourceValueClips: "valueClips",
    Usd.ResolveInfoSourceSpline: "spline",
}


def in_full(value):
    """Returns all parts of asset paths: the text of a path contains only the authored one."""
    paths = [value] if isinstance(value, Sdf.AssetPath) else value
    if not isinstance(value, (Sdf.AssetPath, Sdf.AssetPathArray)):
        return value
    return Vt.StringArray([part for path in paths for part in (path.authoredPath, path.evaluatedPath, path.resolvedPath)])


def said_of(attribute):
    info = attribute.GetResolveInfo()
    times = "".join(f" {time!r}" for time in sorted(attribute.GetTimeSamples()))
    return [SOURCES[info.GetSource()], int(info.ValueIsBlocked()), int(attribute.ValueMightBeTimeVarying()),
            [float(time) for time in times.split()]]


def differences(folder, seed):
    stage = Usd.Stage.Open(RandomStage(folder, seed).write())
    attributes = [attribute for prim in stage.Traverse() for attribute in prim.GetAttributes()]
    lines = "".join(f"{a.GetPrim().GetPath()} {a.GetName()} {a.GetPrim().GetTypeName() or '-'}\n" for a in attributes)
    output = folder / f"ours{seed}.usdc"
    ran = subprocess.run([PROBE, "values", stage.GetRootLayer().realPath, output, *map(repr, TIMES)], input=lines,
                         text=True, check=True, capture_output=True)
    layer = Sdf.Layer.FindOrOpen(str(output))
    for number, (attribute, line) in enumerate(zip(attributes, ran.stdout.splitlines(), strict=True)):
        source, blocked, varying, *times = line.split()
        said = [source, int(blocked), int(varying), [float(time) for time in times]]
        if said != said_of(attribute):
            yield f"{attribute.GetPath()}: {said} and should be {said_of(attribute)}"
        path = f"/_{number}.value"
        spec = layer.GetAttributeAtPath(path)
        ours = [spec and spec.default, *(layer.QueryTimeSample(path, time) for time in TIMES)]
        theirs = [in_full(attribute.Get()), *(in_full(attribute.Get(time)) for time in TIMES)]
        for time, found, expected in zip(["default", *TIMES], ours, theirs, strict=True):
            if "nan" in str(expected):
                continue  # usd-core interpolates from minus infinity before the first sample of an edited array
            if found != expected or type(found) is not type(expected):
                yield f"{attribute.GetPath()} at {time}: {found} and should be {expected}"


@pytest.mark.parametrize("seed", range(20))
def test_values_are_those_of_usd_core(tmp_path, seed):
    assert list(differences(tmp_path, seed)) == []
