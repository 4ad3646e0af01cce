"""Layers that are live are reloaded: the stage shows the project's content at once, and edits go on."""

import pytest
import usdlive
from conftest import connect, wait
from pxr import Sdf, Usd

ROOT = """#usda 1.0
(
    subLayers = [@./sub.usd@]
)
def "A" (
    references = @./asset.usda@</Asset>
    variants = { string v = "one" }
    prepend variantSets = "v"
)
{
    int n = 5
    rel to = </B>
    variantSet "v" = {
        "one" {
            def "One"
            {
            }
        }
    }
}
"""
FILES = {
    "shot.usda": ROOT,
    "sub.usd": '#usda 1.0\nover "A"\n{\n    double x.timeSamples = { 0: 1, 10: 2 }\n}\ndef "B"\n{\n}\n',
    "asset.usda": '#usda 1.0\ndef "Asset"\n{\n    def "Part"\n    {\n        double p = 1\n    }\n}\n',
}
RELOADS = {
    "the stage": lambda stage: stage.Reload(),
    "the root": lambda stage: stage.GetRootLayer().Reload(),
    "the root, forced": lambda stage: stage.GetRootLayer().Reload(force=True),
    "all layers, forced": lambda stage: Sdf.Layer.ReloadLayers(stage.GetUsedLayers(), force=True),
    "the sublayer": lambda stage: stage.GetLayerStack()[-1].Reload(force=True),
    "in a block": lambda stage: in_a_block(stage),
}


def in_a_block(stage):
    with Sdf.ChangeBlock():
        stage.GetRootLayer().Reload(force=True)
        stage.GetLayerStack()[-1].Reload(force=True)


def shown(stage):
    prims = {str(p.GetPath()): {a.GetName(): (a.Get(), a.GetTimeSamples()) for a in p.GetAttributes()}
             for p in stage.TraverseAll()}
    return prims, [str(t) for t in stage.GetRelationshipAtPath("/A.to").GetTargets()]


@pytest.fixture(params=["by address", "attached"])
def shot(request, serve, project):
    """An editor's stage with work that is on the server and not in files, the editor, and a colleague's stage."""
    for name, text in FILES.items():
        layer = Sdf.Layer.CreateAnonymous()
        assert layer.ImportFromString(text) and layer.Export(str(project / name))  # .usd is binary
    server = serve(project)
    with connect(server, "ada") as ada, connect(server, "bo") as bo:
        if request.param == "attached":
            stage = Usd.Stage.Open(str(project / "shot.usda"))
            ada.attach(stage)
        else:
            stage = ada.open_stage("shot.usda")
        theirs = bo.open_stage("shot.usda")
        stage.GetAttributeAtPath("/A.n").Set(6)
        stage.DefinePrim("/A/Mine")
        with Usd.EditContext(stage, stage.GetLayerStack()[-1]):
            stage.GetAttributeAtPath("/A.x").Set(3.0, 20.0)
        assert ada.flush(20)
        wait(lambda: theirs.GetPrimAtPath("/A/Mine") and theirs.GetAttributeAtPath("/A.n").Get() == 6, bo, timeout=20)
        yield stage, ada, theirs, bo


@pytest.mark.parametrize("what", RELOADS)
def test_a_reloaded_layer_keeps_the_projects_content_and_can_be_edited_at_once(shot, what):
    stage, ada, theirs, bo = shot
    before = shown(stage)
    handles = list(stage.TraverseAll())
    lost = []
    ada.add_handler(lambda event: lost.append(event) if isinstance(event, usdlive.events.Lost) else None)
    RELOADS[what](stage)
    assert shown(stage) == before
    assert all(handles) and stage.GetRootLayer().dirty
    stage.GetAttributeAtPath("/A.n").Set(7)
    stage.DefinePrim("/A/Later")
    assert shown(Usd.Stage.Open(stage.GetRootLayer())) == shown(stage)
    assert ada.flush(20)
    wait(lambda: theirs.GetPrimAtPath("/A/Later"), bo, timeout=20)
    assert theirs.GetAttributeAtPath("/A.n").Get() == 7
    assert shown(theirs) == shown(stage)
    assert not lost


def test_work_that_a_reload_discards_is_reported(shot):
    stage, ada, theirs, bo = shot
    lost = []
    ada.add_handler(lambda event: lost.append(event) if isinstance(event, usdlive.events.Lost) else None)
    stage.GetAttributeAtPath("/A.n").Set(8)
    stage.Reload()
    assert stage.GetAttributeAtPath("/A.n").Get() == 6
    assert ada.flush(20)
    assert [("shot.usda was reloaded" in event.message) for event in lost] == [True]
    stage.Reload()
    assert ada.flush(20) and len(lost) == 1
