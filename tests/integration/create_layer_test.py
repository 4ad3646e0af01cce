"""Tests new layers of the project (FI6), notices of progress (PG1), and a missing history."""

import importlib.util
import os
import pathlib
import shutil
import subprocess

import pytest
import usdlive
from conftest import cat, connect, refused_in_a_notice, wait
from pxr import Sdf, Usd, Vt

EXAMPLE = pathlib.Path(__file__).parents[2] / "client" / "examples" / "new_layer.py"


@pytest.fixture
def served(project, serve):
    (project / "shot.usda").write_text("#usda 1.0\n")
    (project / "notes.usda.txt").write_text("")
    return serve(project)


def test_a_new_layer_is_part_of_the_project_for_everybody(served):
    with connect(served, "ada") as ada, connect(served, "bob") as bob:
        stage = bob.open_stage("shot.usda")
        layer = ada.create_layer("effects/fx.usda")
        assert layer.empty and ada.layer_name(layer) == "effects/fx.usda" and not layer.anonymous
        wait(lambda: "effects/fx.usda" in bob.layers(), bob)
        Sdf.CreatePrimInLayer(layer, "/Effects").specifier = Sdf.SpecifierDef
        ada.open_layer("shot.usda").subLayerPaths.append("effects/fx.usda")
        assert ada.flush()
        wait(lambda: bool(stage.GetPrimAtPath("/Effects")), ada, bob)
        assert "effects/fx.usda" in ada.save().saved
    assert 'def "Effects"' in (served.folder / "effects" / "fx.usda").read_text()
    served.kill()
    served.start()
    assert 'def "Effects"' in cat(served, "effects/fx.usda")


def test_the_file_is_there_at_once_and_of_the_format_of_its_name(served):
    with connect(served, "ada") as live:
        for name in ("a.usda", "b.usdc", "c.usd", "D.USDA"):
            assert live.create_layer(name).empty
            assert Sdf.Layer.OpenAsAnonymous(str(served.folder / name)).empty
    assert (served.folder / "D.USDA").read_bytes().startswith(b"#usda")
    assert (served.folder / "b.usdc").read_bytes().startswith(b"PXR-USDC")


def test_only_one_of_two_editors_creates_a_layer(served):
    with connect(served, "ada") as ada, connect(served, "bob") as bob:
        ada.create_layer("fx.usda")
        with pytest.raises(usdlive.Error) as refused:
            bob.create_layer("fx.usda")
        assert refused.value.code == "layerExists" and "open it" in refused.value.message
        assert bob.open_layer("fx.usda").empty


def test_names_that_cannot_be_are_refused(served, tmp_path):
    (served.folder / "folder.usda").mkdir()
    (served.folder / "out").symlink_to(tmp_path)
    (served.folder / "file").write_text("")
    with connect(served, "ada") as live:
        for name, code in (("fx", "invalidLayerName"), ("../fx.usda", "invalidLayerName"),
                           ("fx.usdz", "invalidLayerName"), ("out/fx.usda", "invalidLayerName"),
                           ("a:b.usda", "invalidLayerName"), ("shot.usda", "layerExists"),
                           ("folder.usda", "layerExists"), ("file/fx.usda", "saveFailed")):
            with pytest.raises(usdlive.Error) as refused:
                live.create_layer(name)
            assert refused.value.code == code, (name, refused.value)
            assert name.split("/")[-1] in refused.value.message
        assert live.connected and live.layers() == ["shot.usda"]
    assert not (tmp_path / "fx.usda").exists()


def test_offline_and_from_a_notice_it_says_why_not(served):
    with connect(served, "ada") as live:
        error = refused_in_a_notice(lambda: live.create_layer("from_notice.usda"), live, served)
        assert error.code == "invalidArgument" and "tick()" in error.message
        created = []
        live.add_handler(lambda event: created or created.append(live.create_layer("from_event.usda")))
        with connect(served, "bob") as bob:
            bob.open_layer("shot.usda").comment = "again"
            assert bob.flush()
        wait(lambda: created, live)
        assert created[0].empty
        served.kill()
        wait(lambda: not live.connected, live)
        with pytest.raises(usdlive.Error) as refused:
            live.create_layer("offline.usda")
        assert refused.value.code == "notConnected" and "which names are free" in refused.value.message
        served.start()


def test_the_example_runs(served, capsys):
    spec = importlib.util.spec_from_file_location("new_layer", EXAMPLE)
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    for _ in range(2):
        example.main(served.url, "shot.usda", "effects/fx.usda", "ada")
    assert capsys.readouterr().out == "layers: effects/fx.usda shot.usda\n" * 2
    assert "/Effects" in str(Usd.Stage.Open(Sdf.Layer.FindOrOpen(str(served.folder / "shot.usda"))).GetRootLayer()) or \
        'def Scope "Effects"' in cat(served, "effects/fx.usda")


# -- requests that take long


def test_an_import_a_save_and_an_upload_tell_how_far_they_are(project, serve):
    (project / "shot.usda").write_text("#usda 1.0\n")
    for i in range(150):
        (project / f"l{i:03}.usda").write_text("#usda 1.0\n")
    server = serve(project)
    received = []
    with connect(server, "ada") as live:
        live.add_handler(lambda event: received.append(event) if isinstance(event, usdlive.events.Progress) else None)
        layers = [live.open_layer(f"l{i:03}.usda") for i in range(150)]
        live.tick()
        assert any(one.task == "import" and one.layer == "l000.usda" for one in received)
        for layer in layers:  # big enough that writing all of them takes more than half a second
            attribute = Sdf.AttributeSpec(Sdf.CreatePrimInLayer(layer, "/A"), "v", Sdf.ValueTypeNames.StringArray)
            attribute.default = Vt.StringArray([str(i) for i in range(20_000)])
            assert live.flush(20)
        saved = live.save(timeout=120)
        assert len(saved.saved) == 150
        saves = [one for one in received if one.task == "save"]
        assert saves and all(one.request == saved.request and one.total == 150 for one in saves)
        assert [one.done for one in saves] == sorted(one.done for one in saves) and saves[0].layer.startswith("l")

        shot = live.open_layer("shot.usda")
        attribute = Sdf.AttributeSpec(Sdf.CreatePrimInLayer(shot, "/Big"), "v", Sdf.ValueTypeNames.DoubleArray)
        import random
        noise = random.Random(1).randbytes(8 * 12_000_000)
        attribute.default = Vt.DoubleArray.FromBuffer(memoryview(noise).cast("d"))
        assert live.flush(120)
        uploads = [one for one in received if one.task == "upload"]
        assert uploads and uploads[-1].total >= len(noise) and all(one.done <= one.total for one in uploads)


# -- a missing history
