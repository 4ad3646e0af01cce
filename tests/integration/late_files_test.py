"""Tests files and layers that stages name before they are there: no tick waits for them, and stages show them once
they have arrived."""

from __future__ import annotations

import os
import pathlib
import time

import pytest
from conftest import connect, tick_without_answers, wait, without_answers
from pxr import Sdf, Usd, UsdUtils

ROOT = '''#usda 1.0
(
    subLayers = [@./late.usda@]
)
def "Package" (references = @./late.usdz@)
{
}
def "Set"
{
    def "Part" (
        variants = {
            string model = "full"
        }
        prepend variantSets = "model"
    )
    {
        variantSet "model" = {
            "full" (payload = @./sub/late.obj@) {
            }
        }
    }
}
def "Layer" (references = @./late.usda@</Prop>)
{
}
'''
PROP = 'def "Prop"\n{\n    int size = 7\n}\n'


def write_package(folder: pathlib.Path, made: pathlib.Path) -> None:
    folder.mkdir()
    (folder / "prop.usda").write_text(f'#usda 1.0\n(\n    defaultPrim = "Prop"\n    doc = "{os.urandom(8).hex()}"\n)\n{PROP}')
    assert UsdUtils.CreateNewUsdzPackage(str(folder / "prop.usda"), str(folder / "prop.usdz"))
    os.replace(folder / "prop.usdz", made)


def write_cube(made: pathlib.Path) -> None:
    # Another content in each test and run: no cache knows a cube that is not fetched.
    made.write_text(f"# {os.urandom(8).hex()}\nv 0 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 3\n")


def size(stage: Usd.Stage, path: str):
    attribute = stage.GetAttributeAtPath(path + ".size")
    return attribute.Get() if attribute else None


def meshes(stage: Usd.Stage) -> int:
    return sum(prim.GetTypeName() == "Mesh" for prim in stage.Traverse())


def test_stages_show_files_and_layers_that_are_added_later(serve, project, tmp_path):
    (project / "shot.usda").write_text(ROOT)
    (project / "sub").mkdir()
    server = serve(project)
    with connect(server, "ada") as ada, connect(server, "bo") as bo:
        stages = [live.open_stage("shot.usda") for live in (ada, bo)]
        before = stages[0].GetRootLayer().ExportToString()
        write_package(tmp_path / "package", project / "late.usdz")
        write_cube(project / "sub" / "late.obj")
        layer = bo.create_layer("late.usda")
        prop = Sdf.CreatePrimInLayer(layer, "/Prop")
        Sdf.AttributeSpec(prop, "size", Sdf.ValueTypeNames.Int).default = 7
        prop.specifier = Sdf.SpecifierDef
        for stage in stages:
            wait(lambda stage=stage: (size(stage, "/Package"), size(stage, "/Layer"), size(stage, "/Prop"), meshes(stage))
                 == (7, 7, 7, 1), ada, bo, timeout=30)
        assert ada.pending == bo.pending == 0
        assert stages[0].GetRootLayer().ExportToString() == before


def test_a_tick_does_not_wait_for_a_package_that_an_edit_names(serve, project, tmp_path):
    (project / "shot.usda").write_text('#usda 1.0\ndef "A"\n{\n}\n')
    write_package(tmp_path / "package", project / "there.usdz")
    write_cube(project / "there.obj")
    server = serve(project)
    with connect(server, "ada") as ada, connect(server, "bo") as bo:
        mine, theirs = ada.open_stage("shot.usda"), bo.open_layer("shot.usda")  # only one composes
        for _ in range(5):
            ada.tick()
            time.sleep(0.2)
        with Sdf.ChangeBlock():
            for name, file in (("P", "there.usdz"), ("O", "there.obj"), ("U", "nowhere.usda")):
                prim = Sdf.CreatePrimInLayer(theirs, f"/{name}")
                prim.referenceList.Prepend(Sdf.Reference(f"./{file}"))
        bo.flush(20)
        time.sleep(0.5)  # the edit is here, and waits for the next tick
        with without_answers(server):
            tick_without_answers(ada)
            assert mine.GetPrimAtPath("/P") and size(mine, "/P") is None and meshes(mine) == 0
        wait(lambda: size(mine, "/P") == 7 and meshes(mine) == 1, ada, timeout=30)


def test_unmuting_for_everybody_does_not_wait_for_a_package(serve, project, tmp_path):
    (project / "shot.usda").write_text('#usda 1.0\n(\n    subLayers = [@./set.usda@]\n)\n')
    (project / "set.usda").write_text('#usda 1.0\ndef "P"\n{\n}\n')
    write_package(tmp_path / "package", project / "there.usdz")
    server = serve(project)
    with connect(server, "ada") as ada, connect(server, "bo") as bo:
        bo.open_layer("shot.usda")  # only one composes
        bo.mute("shot.usda", "set.usda")
        assert bo.flush(20)
        mine = ada.open_stage("shot.usda")
        assert not mine.GetPrimAtPath("/P")
        for _ in range(5):
            ada.tick()
            time.sleep(0.2)
        bo.open_layer("set.usda").GetPrimAtPath("/P").referenceList.Prepend(Sdf.Reference("./there.usdz"))
        bo.unmute("shot.usda", "set.usda")
        assert bo.flush(20)
        time.sleep(0.5)  # the edit is here, and waits for the next tick
        with without_answers(server):
            tick_without_answers(ada)
            assert mine.GetPrimAtPath("/P") and size(mine, "/P") is None
        wait(lambda: size(mine, "/P") == 7, ada, timeout=30)
