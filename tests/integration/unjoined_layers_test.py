"""Layers whose file the server cannot read at the moment, because another program is writing it: they refuse edits, no save
claims them, and they are shown when the file is whole."""

import asyncio
import itertools

import pytest
from conftest import connect, wait_frames
from pxr import Sdf, Tf, Usd

from usdlive import events
from usdlive.omni import usd as omni_usd
from usdlive.omni.kit.usd.layers import get_layers

WHOLE = '#usda 1.0\n\ndef "A"\n{\n    double x = 1\n}\n'
CUT = WHOLE[:-4]
MENDED = WHOLE.replace("x = 1", "x = 2")
ROOT = "#usda 1.0\n"
WITH_SUB = "#usda 1.0\n(\n    subLayers = [@./sub.usda@]\n)\n"


class Scene:
    """A context on a stage whose sublayer could not be joined, because its file was cut at that moment. `place`: the stage
    is opened by its name in the project, or in the project's folder. `late`: the sublayer is added to the open stage."""

    def __init__(self, project, serve, place, late, edits_early=False):
        self.sub = project / "sub.usda"
        self.root = project / "root.usda"
        self.sub.write_text(WHOLE)
        self.root.write_text(ROOT if late else WITH_SUB)
        self.live = connect(serve(project), "ada")
        self.lost = []
        self.live.add_handler(lambda event: isinstance(event, events.Lost) and self.lost.append(event))
        if place == "folder":
            self.stage = Usd.Stage.Open(str(self.root))
            if not late:
                self.sub.write_text(CUT)
            self.live.attach(self.stage)
        else:
            self.sub.write_text(CUT)
            self.stage = self.live.open_stage("root.usda")
        self.context = omni_usd.create_context("unjoined")
        assert self.context.attach_stage(self.stage, self.live)
        self.name = Sdf.ComputeAssetPathRelativeToLayer(self.stage.GetRootLayer(), "./sub.usda")
        if edits_early:
            early = Sdf.Layer.FindOrOpen(self.name)
            Sdf.CreatePrimInLayer(early, "/Early")
        if late:
            # The server reads the file as soon as the sublayer is named.
            loaded = Sdf.Layer.FindOrOpen(str(self.sub)) if place == "folder" else None
            self.sub.write_text(CUT)
            self.stage.GetRootLayer().subLayerPaths.append("./sub.usda")
            del loaded
        self.layer = Sdf.Layer.Find(self.name)
        wait_frames(lambda: not self.context.is_live_layer(self.layer) and not self.layer.permissionToEdit)

    def save(self):
        return asyncio.run(self.context.save_stage_async())

    def is_joined(self):
        return self.context.is_live_layer(self.layer) and self.layer.permissionToEdit

    def close(self):
        assert omni_usd.destroy_context("unjoined")
        self.live.close()


@pytest.fixture
def scene(project, serve):
    """scene(place, late) makes a Scene that is closed after the test."""
    scenes = []

    def make(*arguments, **options):
        scenes.append(Scene(project, serve, *arguments, **options))
        return scenes[-1]

    yield make
    for one in scenes:
        one.close()


PLACES = list(itertools.product(["address", "folder"], [False, True]))


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize(("place", "late"), PLACES)
def test_a_layer_that_is_not_joined_refuses_edits_and_is_shown_later(place, late, scene):
    shown = scene(place, late)
    layer, context = shown.layer, shown.context
    assert not context.is_live_layer(layer)
    with pytest.raises(Tf.ErrorException):
        Sdf.CreatePrimInLayer(layer, "/Nowhere")
    state = get_layers(context).get_layers_state()
    assert not state.is_layer_writable(shown.name) and not state.is_layer_savable(shown.name)

    shown.stage.DefinePrim("/InRoot")
    root = shown.stage.GetRootLayer().identifier
    assert shown.save() == (True, "", [root])
    done, text, saved = asyncio.run(context.save_layers_async("", [shown.name]))
    assert not done and "sub.usda" in text and saved == []
    assert "sub.usda" not in shown.live.save("sub.usda").saved
    assert shown.sub.read_text() == CUT and "InRoot" in shown.root.read_text()

    shown.sub.write_text(MENDED)
    wait_frames(shown.is_joined)
    assert shown.stage.GetAttributeAtPath("/A.x").Get() == 2
    Sdf.CreatePrimInLayer(layer, "/Here")
    assert shown.save() == (True, "", [shown.name])
    assert "Here" in shown.sub.read_text() and not shown.lost


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_what_was_written_before_a_layer_joined_is_reported_and_not_saved(scene):
    shown = scene("folder", True, edits_early=True)
    done, _, saved = shown.save()
    assert done and shown.name not in saved and shown.sub.read_text() == CUT
    shown.sub.write_text(MENDED)
    wait_frames(shown.is_joined)
    assert shown.stage.GetAttributeAtPath("/A.x").Get() == 2 and not shown.layer.GetPrimAtPath("/Early")
    assert "/Early" in "".join(shown.live.lost_work_as_layer(one.index, "sub.usda").ExportToString().replace('"', "/")
                               for one in shown.lost)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_a_file_of_the_folder_accepts_edits_again_when_the_connection_is_closed(scene):
    shown = scene("folder", False)
    shown.live.close_layer("sub.usda")
    assert shown.layer.permissionToEdit
