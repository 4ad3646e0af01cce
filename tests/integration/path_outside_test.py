"""Tests that an editor is notified when it writes a path that others cannot open."""

from __future__ import annotations

import pytest
import usdlive
from conftest import connect, wait
from pxr import Sdf, Usd

ROOT = '#usda 1.0\ndef "A"\n{\n    asset tex\n    asset[] many\n}\n'


@pytest.fixture
def server(serve, project):
    (project / "shot.usda").write_text(ROOT)
    (project / "prop.usda").write_text(ROOT)
    return serve(project)


def reports(live) -> list[tuple[str, str, str, str]]:
    found: list = []

    def happened(event):
        if isinstance(event, usdlive.events.PathOutside):
            found.append((event.layer, event.prim, event.property, event.path))
    live.add_handler(happened)
    return found


def test_an_absolute_path_outside_the_project_is_reported_with_layer_prim_and_property(server, tmp_path):
    with connect(server, "ada") as live, connect(server, "bo") as other:
        stage, found = live.open_stage("shot.usda"), reports(live)
        other.open_stage("shot.usda")
        received = reports(other)
        prim = stage.GetPrimAtPath("/A")
        prim.GetAttribute("tex").Set("/home/ada/brick.png")
        prim.GetAttribute("tex").Set("/home/ada/anim.1.png", 1.0)
        prim.GetAttribute("many").Set(Sdf.AssetPathArray(["./ok.png", "C:\\tex\\b.png", "file:///c.png"]))
        prim.GetReferences().AddReference("/home/ada/chair.usdz")
        prim.GetPayloads().AddPayload("/home/ada/table.usda", "/Table")
        prim.SetAssetInfoByKey("identifier", Sdf.AssetPath("/home/ada/asset.usda"))
        root = stage.GetRootLayer()
        root.subLayerPaths.append("/home/ada/sub.usda")
        assert live.flush(20)
        expected = {
            ("shot.usda", "/A", "tex", "/home/ada/brick.png"),
            ("shot.usda", "/A", "tex", "/home/ada/anim.1.png"),
            ("shot.usda", "/A", "many", "C:\\tex\\b.png"),
            ("shot.usda", "/A", "many", "file:///c.png"),
            ("shot.usda", "/A", "", "/home/ada/chair.usdz"),
            ("shot.usda", "/A", "", "/home/ada/table.usda"),
            ("shot.usda", "/A", "", "/home/ada/asset.usda"),
            ("shot.usda", "/", "", "/home/ada/sub.usda"),
        }
        assert set(found) == expected and len(found) == len(expected), found
        # Neither the removal of such a path nor an edit of somebody else is reported.
        found.clear()
        prim.GetReferences().RemoveReference(Sdf.Reference("/home/ada/chair.usdz"))
        prim.GetAttribute("tex").Clear()
        assert live.flush(20)
        wait(lambda: other.revision >= live.revision, other)
        assert found == [] and received == []


def test_paths_that_others_can_open_are_not_reported(server, project):
    with connect(server, "ada") as live:
        stage, found = live.open_stage("shot.usda"), reports(live)
        prim = stage.GetPrimAtPath("/A")
        addresses = ["./tex/brick.png", "../brick.png", "brick.png", "", "a/b.<UDIM>.png",
                     f"usdlive://127.0.0.1:{server.port}/brick.png", live.identifier("prop.usda")]
        for path in addresses:
            prim.GetAttribute("tex").Set(path)
            assert live.flush(20)
        prim.GetReferences().AddReference("./prop.usda")
        prim.CreateAttribute("text", Sdf.ValueTypeNames.String).Set("/home/ada/brick.png")
        assert live.flush(20)
        assert found == []
    # An absolute path into the project's folder, of an editor that works there.
    stage = Usd.Stage.Open(str(project / "shot.usda"))
    with connect(server, "ada") as live:
        live.attach(stage)
        found = reports(live)
        stage.GetPrimAtPath("/A").GetAttribute("tex").Set(str(project / "tex" / "brick.png"))
        stage.GetPrimAtPath("/A").GetAttribute("many").Set(Sdf.AssetPathArray([f"{project}/../x.png"]))
        assert live.flush(20)
        assert [one[2:] for one in found] == [("many", f"{project}/../x.png")]


def test_a_paste_of_many_such_paths_is_reported_to_a_bound(server):
    with connect(server, "ada") as live:
        stage, found = live.open_stage("shot.usda"), reports(live)
        with Sdf.ChangeBlock():
            for number in range(1_500):
                spec = Sdf.CreatePrimInLayer(stage.GetRootLayer(), f"/P{number}")
                Sdf.AttributeSpec(spec, "tex", Sdf.ValueTypeNames.Asset).default = Sdf.AssetPath(f"/x/{number}.png")
        assert live.flush(20)
        assert len(found) == 1_000
