"""Real stages of the newton package are served, edited by two editors, saved, and read by pxr.Usd alone."""

import importlib.util
import os
import pathlib
import shutil
import subprocess
import sys

import pytest
from conftest import cat
from pxr import Sdf

NEWTON = pathlib.Path(importlib.util.find_spec("newton").submodule_search_locations[0])
STAGES = sorted([*(NEWTON / "examples" / "assets").glob("*.usd*"),
                 *(NEWTON / "tests" / "assets").glob("*.usda")])


def text_of(path) -> str:
    """Returns the text, in a process without our code."""
    return subprocess.run(
        [sys.executable, "-c", "import sys; from pxr import Sdf; layer = Sdf.Layer.FindOrOpen(sys.argv[1]); "
         "print(end=layer.ExportToString())", str(path)],
        capture_output=True, text=True, check=True).stdout


def test_real_stages_are_served_exactly(project, serve):
    """The server's text of each layer equals pxr's text of the file."""
    names = {stage: f"{stage.parts[-3]}/{stage.name}" for stage in STAGES}
    for stage, name in names.items():
        (project / name).parent.mkdir(exist_ok=True)
        shutil.copy(stage, project / name)
    server = serve(project)
    listed = subprocess.run([os.environ["USDLIVE_BIN"], "ls", server.url], capture_output=True,
                            text=True, check=True).stdout
    for stage, name in names.items():
        assert name in listed
        assert cat(server, name) == Sdf.Layer.FindOrOpen(str(stage)).ExportToString()


@pytest.mark.parametrize("name", ["humanoid.usda", "crazyflie.usd", "bunny.usd"])
def test_a_real_stage_is_edited_and_saved(name, project, serve, editor):
    shutil.copy(NEWTON / "examples" / "assets" / name, project / name)
    server = serve(project)
    ada, bo = editor(server, "ada", name), editor(server, "bo", name)
    assert ada.text(name) == bo.text(name) == text_of(NEWTON / "examples" / "assets" / name)
    ada.run("for prim in stage.Traverse():\n"
            " if prim.IsA(UsdGeom.Gprim):\n"
            "  UsdGeom.Gprim(prim).CreateDisplayColorAttr([(1, 0, 0)])\n")
    bo.catch_up(ada.flush())
    bo.run("for prim in list(stage.Traverse())[::3]:\n prim.SetCustomDataByKey('seen:by', 'bo')\n")
    ada.catch_up(bo.flush())
    assert ada.text(name) == bo.text(name) == cat(server, name)
    ada.run("live.save(); assert live.wait("
            "lambda: any(type(e).__name__ == 'Saved' and e.saved for e in happened), 20), happened")
    assert text_of(project / name) == ada.text(name)
    binary = (project / name).read_bytes()[:8] == b"PXR-USDC"
    assert binary == ((NEWTON / "examples" / "assets" / name).read_bytes()[:8] == b"PXR-USDC")


def test_a_file_that_is_added_later_is_served(project, serve, editor):
    (project / "shot.usda").write_text("#usda 1.0\n")
    server = serve(project)
    ada = editor(server, "ada", "shot.usda")
    (project / "prop.usda").write_text('#usda 1.0\n\ndef "Prop"\n{\n}\n')
    ada.run("assert live.wait(lambda: 'prop.usda' in live.layers(), 20), live.layers()")
    ada.run("stage.DefinePrim('/Prop').GetReferences().AddReference('prop.usda', '/Prop')\n"
            "assert live.open_layer('prop.usda').GetPrimAtPath('/Prop')")
    assert cat(server, "prop.usda") == text_of(project / "prop.usda")
