"""Arcs that name a layer of the project with file format arguments: OpenUSD opens such a layer once more."""

from __future__ import annotations

import pytest
from conftest import cat, connect, wait
from pxr import Sdf, Tf, Usd

ARGUMENTS = ":SDF_FORMAT_ARGS:who=a&x=a b"
SHOT = f"""#usda 1.0
(
    subLayers = [@./look.usda{ARGUMENTS}@]
)
def "P" ( prepend references = @./asset.usda{ARGUMENTS}@</A> ) {{}}
def "Q" ( payload = @./asset.usda@</A> ) {{}}
"""


def shown(stage: Usd.Stage) -> list:
    return [stage.GetAttributeAtPath(path).Get() if stage.GetAttributeAtPath(path) else None
            for path in ("/P.look", "/P.v", "/Q.v")]


def layer(live, name: str) -> Sdf.Layer:
    return Sdf.Layer.Find(live.identifier(name))


@pytest.fixture
def server(tmp_path, serve):
    folder = tmp_path / "arguments"
    folder.mkdir()
    (folder / "shot.usda").write_text(SHOT)
    (folder / "look.usda").write_text('#usda 1.0\nover "P" {\n    double look = 1\n}\n')
    (folder / "asset.usda").write_text('#usda 1.0\ndef "A" {\n    double v = 1\n}\n')
    (folder / "plain.usda").write_text('#usda 1.0\ndef "P" {}\ndef "Q" {}\n')
    return serve(folder)


def test_a_layer_with_arguments_shows_the_live_layer(server, editor, capfd):
    live = connect(server, "mara")
    stage = live.open_stage("shot.usda")
    assert shown(stage) == [1, 1, 1]
    assert "Unresolved" not in capfd.readouterr().err
    other = editor(server, "noor", "look.usda")
    other.run("layer('look.usda').GetAttributeAtPath('/P.look').default = 2.0")
    other.flush()
    layer(live, "asset.usda").GetAttributeAtPath("/A.v").default = 3.0
    wait(lambda: shown(stage) == [2, 3, 3], live)
    live.save()
    assert shown(Usd.Stage.Open(str(server.folder / "shot.usda"))) == [2, 3, 3]
    live.close()


def test_a_layer_with_arguments_refuses_edits(server):
    live = connect(server, "mara")
    stage = live.open_stage("shot.usda")
    view = next(layer for layer in stage.GetLayerStack(False) if "SDF_FORMAT_ARGS" in layer.identifier)
    assert not view.permissionToEdit
    with pytest.raises(Tf.ErrorException, match="not editable"):
        stage.SetEditTarget(view)
        stage.OverridePrim("/P").SetCustomDataByKey("mine", 1)
    live.flush()
    assert "mine" not in cat(server, "look.usda")
    live.close()


def test_a_colleague_adds_an_arc_with_arguments(server, editor):
    live = connect(server, "mara")
    stage = live.open_stage("plain.usda")
    other = editor(server, "noor", "plain.usda")
    other.run(f"layer('plain.usda').subLayerPaths.append('./look.usda{ARGUMENTS}')\n"
              f"layer('plain.usda').GetPrimAtPath('/P').referenceList.Prepend("
              f"Sdf.Reference('./asset.usda{ARGUMENTS}', '/A'))")
    other.flush()
    wait(lambda: shown(stage)[:2] == [1, 1], live)
    layer(live, "plain.usda").GetPrimAtPath("/Q").payloadList.Prepend(Sdf.Payload(f"./asset.usda{ARGUMENTS}", "/A"))
    wait(lambda: shown(stage) == [1, 1, 1], live)
    layer(live, "asset.usda").GetAttributeAtPath("/A.v").default = 5.0
    wait(lambda: shown(stage) == [1, 5, 5], live)
    live.close()
