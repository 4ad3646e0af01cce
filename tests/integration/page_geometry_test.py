"""What the gateway of the page reads from stages, compared with UsdGeom."""

import os
import shutil
import subprocess
import sys

import numpy
import pytest
from page_client import Gateway, Page
from pxr import Usd, UsdGeom
from stages_test import NEWTON, STAGES

_BOX = """
import json, sys
from pxr import Usd, UsdGeom
stage = Usd.Stage.Open(sys.argv[1])
xforms = UsdGeom.XformCache()
boxes = UsdGeom.BBoxCache(Usd.TimeCode.Default(), ["default", "render", "proxy", "guide"], False, False)
found = {}
for prim in Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)):
    if prim.IsA(UsdGeom.Imageable):
        box = boxes.ComputeRelativeBound(prim, stage.GetPseudoRoot()).ComputeAlignedRange() if False else None
        entry = {"world": [v for row in xforms.GetLocalToWorldTransform(prim) for v in row], "visible": UsdGeom.Imageable(prim).ComputeVisibility() != "invisible"}
        if prim.IsA(UsdGeom.Gprim):
            extent = UsdGeom.Boundable.ComputeExtentFromPlugins(UsdGeom.Boundable(prim), Usd.TimeCode.Default())
            entry["extent"] = [v for corner in extent for v in corner] if extent else None
        found[str(prim.GetPath())] = entry
print(json.dumps(found))
"""


@pytest.fixture
def gateway(tmp_path):
    gateways = []

    def start(server, *options, **environment):
        folder = tmp_path / f"gateway{len(gateways)}"
        folder.mkdir()
        gateways.append(Gateway(server.url, folder, *options, **environment).start())
        return gateways[-1]

    yield start
    for one in gateways:
        if one.process.poll() is None:
            assert one.stop() == 0, one.log.read_text()
