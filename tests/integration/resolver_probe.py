"""Opens a stage by an address or a path, without usdlive's library, and prints what everything in it resolves to:

    python resolver_probe.py ROOT
"""

from __future__ import annotations

import hashlib
import json
import sys

from pxr import Ar, Sdf, Usd, UsdShade


def content_hash(resolved) -> str:
    """The SHA-256 of what a resolved path names, or why there is none."""
    if not str(resolved):
        return "unresolved"
    asset = Ar.GetResolver().OpenAsset(Ar.ResolvedPath(str(resolved)))
    if not asset:
        return "unreadable"
    with asset:
        return hashlib.sha256(bytes(asset.GetBuffer())).hexdigest()


def describe(value):
    if isinstance(value, Sdf.AssetPath):
        return [value.path, content_hash(value.resolvedPath)]
    if isinstance(value, Sdf.AssetPathArray):
        return [describe(one) for one in value]
    if isinstance(value, dict):
        return {key: describe(one) for key, one in value.items()}
    return str(value)


def tiles(stage, attribute, value):
    """The tiles of a UDIM texture, as a renderer finds them."""
    if not isinstance(value, Sdf.AssetPath) or not UsdShade.UdimUtils.IsUdimIdentifier(value.path):
        return None
    layer = attribute.GetPropertyStack(Usd.TimeCode.Default())[0].layer
    whole = UsdShade.UdimUtils.ResolveUdimPath(value.path, layer)
    found = {tile: content_hash(path)
             for path, tile in UsdShade.UdimUtils.ResolveUdimTilePaths(value.path, layer)}
    # A renderer keeps the pattern and puts the numbers of tiles into it.
    return {"found": found, "pattern": {tile: content_hash(whole.replace("<UDIM>", tile)) for tile in found}}


def probe(root: str):
    assert "usdlive" not in sys.modules
    return probe_stage(Usd.Stage.Open(root))


def probe_stage(stage: Usd.Stage):
    with Ar.ResolverContextBinder(stage.GetPathResolverContext()):
        everything = {"prims": [], "assets": {}, "layers": [], "tiles": {}}
        for prim in stage.TraverseAll():
            everything["prims"].append(f"{prim.GetPath()} {prim.GetTypeName()}")
            if prim.HasAuthoredMetadata("assetInfo"):
                everything["assets"][f"{prim.GetPath()} assetInfo"] = describe(prim.GetMetadata("assetInfo"))
            for attribute in prim.GetAttributes():
                for time in [Usd.TimeCode.Default(), *attribute.GetTimeSamples()]:
                    value = attribute.Get(time)
                    everything["assets"][f"{attribute.GetPath()} {time}"] = describe(value)
                    if (found := tiles(stage, attribute, value)) is not None:
                        everything["tiles"][str(attribute.GetPath())] = found
        everything["layers"] = sorted(hashlib.sha256(layer.ExportToString().encode()).hexdigest()
                                      for layer in stage.GetUsedLayers(includeClipLayers=True)
                                      if not layer.anonymous)
        everything["errors"] = sorted(type(error).__name__ for error in stage.GetCompositionErrors())
    return everything


if __name__ == "__main__":
    json.dump(probe(sys.argv[1]), sys.stdout)
