"""An edit that is accepted is acknowledged, in the journal, or reported: no work goes nowhere."""

import asyncio
import contextlib
import gc
import math
import os
import random
import signal
import subprocess
import sys
import threading
import time

import pytest
from conftest import cat, connect, wait, without_answers
from pxr import Gf, Sdf, Tf, Usd, UsdGeom

import usdlive
from usdlive import events

SHOT = '#usda 1.0\n(\n    subLayers = [@./layout.usda@]\n)\n\ndef Xform "World"\n{\n    double x = 0\n}\n'
LAYOUT = '#usda 1.0\n\nover "World"\n{\n    def Scope "Props"\n    {\n    }\n}\n'
BAD = "#usda 1.0\n<<<<<<< ours\n"
CRATE = ('#usda 1.0\n(\n    defaultPrim = "Crate"\n)\n\ndef Xform "Crate" (\n    references = @./parts/lid.usda@\n)\n{\n'
         '    def Cube "Mesh"\n    {\n        double size = 4\n    }\n}\n')
LID = '#usda 1.0\n(\n    defaultPrim = "Lid"\n)\n\ndef Xform "Lid"\n{\n    def Cube "Plate"\n    {\n    }\n}\n'


@pytest.fixture
def server(project, serve):
    (project / "shot.usda").write_text(SHOT)
    (project / "layout.usda").write_text(LAYOUT)
    return serve(project)


def edit(stage: Usd.Stage, path: str = "/World/Edited") -> None:
    stage.DefinePrim(path)


def refuses(stage: Usd.Stage) -> bool:
    with pytest.raises(Tf.ErrorException):
        edit(stage)
    return not stage.GetPrimAtPath("/World/Edited")


# ---- placeholders


def test_a_layer_that_cannot_be_read_refuses_edits_until_its_file_is_mended(project, server):
    (project / "layout.usda").write_text(BAD)
    with connect(server, "ada") as ada:
        with pytest.warns(RuntimeWarning, match="layout.usda has no content here and refuses edits: .*layout.usda"):
            stage = ada.open_stage("shot.usda")  # which reports it if the answer is here early
            ada.tick()
        layout = Sdf.Layer.Find(ada.identifier("layout.usda"))
        stage.SetEditTarget(layout)
        assert refuses(stage) and ada.layer_name(layout) is None
        assert ada.save().failed == ()
        with pytest.raises(usdlive.Error, match="layout.usda"):
            ada.open_layer("layout.usda")
        ada.add_handler(lambda event: pytest.fail(str(event)) if isinstance(event, events.JoinFailed) else None)
        (project / "layout.usda").write_text(LAYOUT)
        wait(lambda: layout.permissionToEdit, ada)
        assert stage.GetPrimAtPath("/World/Props") and ada.layer_name(layout) == "layout.usda"
        edit(stage)
        assert ada.flush()
    assert "Edited" in cat(server, "layout.usda")


def test_layers_that_are_no_longer_live_refuse_edits(project, server):
    ada = connect(server, "ada")
    stage = ada.open_stage("shot.usda")
    ada.close_layer("layout.usda")
    stage.SetEditTarget(Sdf.Layer.Find(ada.identifier("layout.usda")))
    assert refuses(stage)
    stage.SetEditTarget(stage.GetRootLayer())
    assert ada.connected
    ada.close()
    assert not ada.connected
    assert refuses(stage)
    stage.GetRootLayer().SetPermissionToEdit(True)
    edit(stage)  # a copy of one's own
    own = Usd.Stage.Open(str(project / "shot.usda"))
    with connect(server, "bob") as bob:
        bob.attach(own)
    edit(own)  # a file of this machine, which the editor may save


@pytest.mark.parametrize("backend", ["fast", "portable"])
def test_layers_of_a_connection_that_was_collected_refuse_edits(server, backend):
    def opened():
        return connect(server, "ada", backend).open_stage("shot.usda")

    with pytest.warns(RuntimeWarning, match="was not closed, .* refuse edits"):
        stage = opened()
        gc.collect()
    assert refuses(stage)

    def edited():
        live = connect(server, "ada", backend)
        edit(live.open_stage("shot.usda"))

    with pytest.warns(RuntimeWarning, match="was not closed"):
        edited()
        gc.collect()
    with connect(server, "ada") as ada:
        (work,) = ada.unsent_work() or (None,)
        assert (work and work.as_layer("shot.usda").GetPrimAtPath("/World/Edited")) or "Edited" in cat(server, "shot.usda")


def in_child(function) -> bool:
    """Calls the function in a process that fork() makes. Returns whether it raised nothing."""
    child = os.fork()
    if child == 0:
        signal.alarm(60)
        status = 1
        with contextlib.suppress(BaseException):
            function()
            status = 0
        os._exit(status)
    return os.waitpid(child, 0)[1] == 0


def test_after_fork_the_connection_belongs_to_the_parent(server):
    with connect(server, "ada") as ada:
        stage = ada.open_stage("shot.usda")
        edit(stage, "/World/Before")

        def child():
            assert refuses(stage)
            for call in (ada.tick, ada.close, lambda: ada.open_stage("layout.usda")):
                with pytest.raises(usdlive.Error, match=r"fork\(\)"):
                    call()
            with connect(server, "child") as own:  # a new connection works
                Sdf.CreatePrimInLayer(own.open_layer("shot.usda"), "/OfTheChild")

        assert in_child(child)
        # Also in a child that ends as Python programs end: it does not destroy the stage, which might wait for ever.
        ended = subprocess.run([sys.executable, "-c", (
            "import os, sys, usdlive, weakref\n"
            "live = usdlive.connect(sys.argv[1], user='cy')\n"
            "stage = live.open_stage('shot.usda')\n"
            "child = os.fork()\n"
            "if child == 0:\n"
            "    kept = weakref.ref(stage)\n"
            "    del stage\n"
            "    sys.exit(7 if kept() else 8)\n"
            "assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 7\n"
            "stage.DefinePrim('/World/OfCy'); assert live.flush(); live.close()\n"), server.url],
            capture_output=True, text=True, timeout=60, check=False)
        assert ended.returncode == 0 and not ended.stderr, ended.stderr
        edit(stage, "/World/After")
        assert ada.flush()
    text = cat(server, "shot.usda")
    assert all(name in text for name in ("Before", "After", "OfTheChild", "OfCy"))


def test_an_edit_on_another_thread_raises_there(server):
    with connect(server, "ada") as ada:
        stage = ada.open_stage("shot.usda")
        raised = []

        def work():
            for number in range(2):
                try:
                    edit(stage, f"/World/Edited{number}")
                except Tf.ErrorException as error:
                    raised.append(str(error))

        thread = threading.Thread(target=work)
        thread.start()
        thread.join()
        assert len(raised) == 2 and all("another thread" in one and "shot.usda" in one for one in raised)
        with pytest.warns(RuntimeWarning, match="not in the project"):
            assert ada.flush()
        assert not stage.GetPrimAtPath("/World/Edited0")


# ---- what a caller chooses


NAN = float("nan")
ODD_PRESENCES = {
    "camera of 3": {"camera": [1, 2, 3]}, "camera of 17": {"camera": [1.0] * 17}, "camera nan": {"camera": [NAN] * 16},
    "matrix nan": {"camera": Gf.Matrix4d(NAN)}, "camera inf": {"camera": [math.inf] * 16}, "time nan": {"time": NAN},
    "time inf": {"time": math.inf}, "20,000 selected": {"selection": [f"/World/Props/crate_{i}" for i in range(20_000)]},
    "data 100 KiB": {"data": "x" * 100_000}, "target": {"edit_target": "x" * 70_000}, "surrogate": {"data": "\udc80"}}


def test_no_value_of_a_call_ends_the_connection(server):
    with connect(server, "ada") as ada, connect(server, "bob") as bob:
        lost = []
        ada.add_handler(lambda event: lost.append(event) if isinstance(event, events.Disconnected) else None)
        ada.show_presence(["/World"])
        for name, values in ODD_PRESENCES.items():
            with pytest.raises((usdlive.Error, TypeError, UnicodeError)):
                ada.show_presence(**values)
                pytest.fail(name)
        for call in (lambda: ada.create_checkpoint("\udc80"), lambda: ada.create_checkpoint("x" * 100_000),
                     lambda: ada.create_checkpoint(""), lambda: ada.create_layer("x" * 5_000 + ".usda"),
                     lambda: ada.create_layer("a\0b.usda"), lambda: ada.open_layer("\udc80.usda"),
                     lambda: ada.upload(__file__, "x" * 70_000), lambda: ada.upload(__file__, "\udc80"),
                     lambda: ada.ask("compactHistory", days=2**64 - 1), lambda: ada.ask("uploadFile", path="\0", size=1)):
            with pytest.raises((usdlive.Error, TypeError, ValueError, UnicodeError)):
                call()
        wait(lambda: [one.selection for one in bob.presences()] == [("/World",)], ada, bob)
        assert not lost and ada.connected
    for user, application in (("x" * 300, "test"), ("\udc80", "test"), ("ada", "x" * 70_000)):
        with pytest.raises((usdlive.Error, TypeError, UnicodeError)):
            usdlive.connect(server.url, user=user, application=application)


# ---- references


def test_a_reference_that_the_editor_adds_shows_at_once_what_it_brings(project, serve):
    (project / "shot.usda").write_text(SHOT)
    (project / "layout.usda").write_text(LAYOUT)
    (project / "props" / "parts").mkdir(parents=True)
    (project / "props" / "crate.usda").write_text(CRATE)
    (project / "props" / "parts" / "lid.usda").write_text(LID)
    for number in range(3):
        (project / "props" / f"crate{number}.usda").write_text(CRATE)
    Sdf.Layer.FindOrOpen(str(project / "props" / "crate.usda")).Export(str(project / "props" / "binary.usdc"))
    server = serve(project)
    with connect(server, "bob") as bob:  # newer than the file
        bob.open_layer("props/crate.usda").GetAttributeAtPath("/Crate/Mesh.size").default = 6.0
        assert bob.flush()
        with connect(server, "ada") as ada:
            stage = ada.open_stage("shot.usda")
            prim = stage.DefinePrim("/World/A", "Xform")
            prim.GetReferences().AddReference("./props/crate.usda")
            assert {child.GetName() for child in prim.GetChildren()} == {"Plate", "Mesh"}
            bounds = UsdGeom.BBoxCache(Usd.TimeCode.Default(), ["default"]).ComputeWorldBound(prim)
            assert bounds.ComputeAlignedRange().GetMax() == Gf.Vec3d(3, 3, 3)
            stage.DefinePrim("/World/B", "Xform").GetPayloads().AddPayload("./props/binary.usdc")
            assert stage.GetPrimAtPath("/World/B/Mesh")
            stage.GetRootLayer().subLayerPaths.append("./props/crate0.usda")
            assert stage.GetPrimAtPath("/Crate/Mesh")
            crate = Sdf.Layer.Find(ada.identifier("props/crate.usda"))
            assert ada.layer_name(crate) == "props/crate.usda"
            with pytest.raises(Tf.ErrorException):
                crate.comment = "before it is live"
            wait(lambda: crate.permissionToEdit, ada)
            crate.comment = "live"
            assert ada.flush() and prim.GetChildren()
            # Without an answer the call takes no longer than opening does, and without a connection it does not wait.
            server.kill()
            wait(lambda: not ada.connected, ada)
            began = time.monotonic()
            stage.DefinePrim("/World/C").GetReferences().AddReference("./props/crate1.usda")
            assert time.monotonic() - began < 1
            server.start()
            wait(lambda: ada.connected and stage.GetPrimAtPath("/World/C/Mesh"), ada)
    assert "live" in cat(server, "props/crate.usda")


# ---- calls


def test_nested_gestures_are_one_commit(server):
    with connect(server, "ada") as ada:
        stage = ada.open_stage("shot.usda")
        assert ada.flush()
        before = ada.revision
        with ada.gesture():
            edit(stage, "/World/One")
            with ada.gesture():
                edit(stage, "/World/Two")
                ada.tick()
            edit(stage, "/World/Three")
            ada.tick()
        assert ada.flush() and ada.revision == before + 1
        ada.end_gesture()  # none is open
        edit(stage, "/World/Four")
        assert ada.flush() and ada.revision == before + 2


def test_reload_returns_when_it_is_done(project, server):
    with connect(server, "ada") as ada:
        layer = ada.open_layer("layout.usda")
        (project / "layout.usda").write_text(LAYOUT.replace("Props", "Others"))
        done = ada.reload("layout.usda")
        assert done.reloaded == ("layout.usda",) and layer.GetPrimAtPath("/World/Others")
        assert [failure.layer for failure in ada.reload("absent.usda").failed] == ["absent.usda"]


def test_the_event_loop_goes_on_while_a_connection_and_a_stage_are_made(server):
    async def work():
        with contextlib.closing(await usdlive.connect_async(server.url, user="ada")) as ada:
            stage = await ada.open_stage_async("shot.usda")
            edit(stage)
            assert ada.flush()
        with pytest.raises(usdlive.Error):
            await usdlive.connect_async("ws://127.0.0.1:1")
        with without_answers(server):
            connecting = asyncio.ensure_future(usdlive.connect_async(server.url, user="bob", timeout=1))
            counted = 0
            while not connecting.done():
                await asyncio.sleep(0.01)
                counted += 1
            assert counted > 20 and isinstance(connecting.exception(), usdlive.Error)

    asyncio.run(work())
    assert "Edited" in cat(server, "shot.usda")


# ---- the invariant, in every situation and for every kind of edit


def define(layer: Sdf.Layer, mark: str) -> None:
    Usd.Stage.Open(layer).DefinePrim(f"/World/{mark}")


def create(layer: Sdf.Layer, mark: str) -> None:
    Sdf.CreatePrimInLayer(layer, f"/{mark}")


def set_field(layer: Sdf.Layer, mark: str) -> None:
    layer.pseudoRoot.SetInfo("documentation", mark)


def set_key(layer: Sdf.Layer, mark: str) -> None:
    layer.customLayerData = {**layer.customLayerData, mark: mark}


def set_sample(layer: Sdf.Layer, mark: str) -> None:
    Sdf.JustCreatePrimAttributeInLayer(layer, f"/World.{mark}", Sdf.ValueTypeNames.Double)
    layer.SetTimeSample(f"/World.{mark}", 1.0, 2.0)


def set_value(layer: Sdf.Layer, mark: str) -> None:
    stage = Usd.Stage.Open(layer)
    stage.OverridePrim(f"/V{mark}").CreateAttribute(mark, Sdf.ValueTypeNames.String).Set(mark)


def copy(layer: Sdf.Layer, mark: str) -> None:
    other = Sdf.Layer.CreateAnonymous(".usda")
    Sdf.CreatePrimInLayer(other, f"/{mark}")
    if not Sdf.CopySpec(other, f"/{mark}", layer, f"/{mark}"):
        raise RuntimeError("refused")


def batch(layer: Sdf.Layer, mark: str) -> None:
    source = Sdf.CreatePrimInLayer(layer, f"/From{mark[1:]}")
    edits = Sdf.BatchNamespaceEdit()
    edits.Add(source.path, f"/{mark}")
    if not layer.Apply(edits):
        raise RuntimeError("refused")


def transfer(layer: Sdf.Layer, mark: str) -> None:
    other = Sdf.Layer.CreateAnonymous(".usda")
    other.TransferContent(layer)
    Sdf.CreatePrimInLayer(other, f"/{mark}")
    layer.TransferContent(other)


def sublayer(layer: Sdf.Layer, mark: str) -> None:
    layer.subLayerPaths.append(f"./{mark}.usda")


EDITS = [define, create, set_field, set_key, set_sample, set_value, copy, batch, transfer, sublayer]


class Situation:
    """A live layer, and what happens to it before and after the edits."""

    def __init__(self, server, name: str):
        self.server, self.name = server, name
        self.live = connect(server, "ada")
        self.lost: list[str] = []
        self.live.add_handler(self.note)
        self.layer = self.raised = None

    def note(self, event) -> None:
        if isinstance(event, events.Lost):
            for index in range(event.index - event.count + 1, event.index + 1):
                for file in ("target.usda", "late.usda"):
                    self.lost.append(self.live.lost_work_as_layer(index, file).ExportToString())

    def enter(self) -> None:
        live, name = self.live, self.name
        if name in ("placeholder", "unreadable"):
            file = "bad.usda" if name == "unreadable" else "late.usda"
            if name == "unreadable":
                with contextlib.suppress(usdlive.Error):
                    live.open_layer(file)
            self.layer = Sdf.Layer.FindOrOpen(live.identifier(file))
            return
        self.layer = live.open_layer("target.usda")
        if name == "closed layer":
            live.close_layer("target.usda")
        elif name == "closed client":
            live.close()
        elif name == "collected":
            live.remove_handler(self.note)
            self.live = live = None
            gc.collect()
        elif name == "offline":
            self.server.kill()
            wait(lambda: not live.connected, live)
        elif name == "locked":
            with connect(self.server, "bob") as bob:
                bob.open_layer("target.usda")
                bob.lock("target.usda")
                assert bob.flush()
            wait(lambda: live.layer_states()["target.usda"].locked, live)
        elif name == "muted":
            Sdf.Layer.AddToMutedLayers(self.layer.identifier)
        elif name == "reloaded":
            self.layer.Reload(force=True)

    def perform(self, function, mark: str) -> bool:
        """Returns whether the edit was accepted."""
        accepted = []

        def work():
            with contextlib.suppress(Tf.ErrorException, RuntimeError, usdlive.Error):
                function(self.layer, mark)
                accepted.append(True)

        if self.name == "thread":
            thread = threading.Thread(target=work)
            thread.start()
            thread.join()
        elif self.name == "fork":
            def of_child():
                work()
                assert not accepted

            return not in_child(of_child)
        else:
            work()
        return bool(accepted)

    def leave(self) -> str:
        """Returns the text of all places where an edit may be."""
        if self.name == "muted":
            Sdf.Layer.RemoveFromMutedLayers(self.layer.identifier)
        if self.live is not None and not self.live.closed:
            if self.name != "offline":
                assert self.live.flush()
            self.live.close(timeout=0.2)
        if self.name == "offline":
            self.server.start()
        texts = [*self.lost, *(cat(self.server, name) for name in ("target.usda", "late.usda"))]
        with connect(self.server, "ada") as later:
            for work in later.unsent_work():
                texts.append(work.as_layer("target.usda").ExportToString())
                work.discard()
        return "\n".join(texts)


SITUATIONS = ["live", "placeholder", "unreadable", "collected", "fork", "thread", "closed layer", "closed client", "offline",
              "locked", "muted", "reloaded"]


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("name", SITUATIONS)
def test_an_accepted_edit_is_acknowledged_or_kept_or_reported(project, serve, name):
    for file in ("target.usda", "late.usda"):
        (project / file).write_text(SHOT.replace("./layout.usda", "./none.usda"))
    (project / "bad.usda").write_text(BAD)
    server = serve(project)
    for seed in range(2):
        chosen = random.Random(f"{name} {seed}")
        situation = Situation(server, name)
        situation.enter()
        kinds = chosen.sample(EDITS, len(EDITS))
        marks = {f"m{seed}{kind.__name__}".replace("_", ""): kind for kind in kinds}
        accepted = {mark for mark, kind in marks.items() if situation.perform(kind, mark)}
        if name in ("live", "offline"):
            assert len(accepted) == len(marks)
        if name in ("unreadable", "collected", "fork", "closed layer", "closed client"):
            assert not accepted
        text = situation.leave()
        assert not {mark for mark in accepted if mark not in text}, f"seed {seed}: accepted, and nowhere\n{text[-2000:]}"
