"""Mistakes of newcomers: each gets a clear error, none ends the process or loses work."""

import os
import subprocess
import sys
import threading
import time

import pytest
from conftest import connect, run, wait
from pxr import Sdf, Tf, Usd

import usdlive
from usdlive import events
from usdlive.portable.live import NotInPortable

ROOT = '#usda 1.0\n\ndef "World"\n{\n    double x = 0\n}\n'


@pytest.fixture
def server(project, serve):
    (project / "shot.usda").write_text(ROOT)
    (project / "look.usda").write_text('#usda 1.0\n\ndef "Look"\n{\n}\n')
    return serve(project)


def collected(live: usdlive.Live, kind: type) -> list:
    """Collects the events of one kind from now on."""
    happened: list = []
    live.add_handler(lambda event: happened.append(event) if isinstance(event, kind) else None)
    return happened


@pytest.mark.parametrize("backend", ["fast", "portable"])
def test_every_function_of_a_closed_connection_raises(server, backend):
    live = connect(server, "ada", backend)
    live.open_layer("shot.usda")
    live.close()
    live.close()
    stage = Usd.Stage.CreateInMemory()
    calls = [live.tick, live.flush, live.layers, lambda: live.open_layer("shot.usda"),
             lambda: live.open_stage("shot.usda"), lambda: live.request_open_layer("shot.usda"),
             lambda: live.opened_layer("shot.usda"), lambda: live.close_layer("shot.usda"),
             lambda: live.attach(stage), lambda: live.attach(stage, "/tmp"), live.save, live.request_save,
             live.reload, live.begin_gesture, live.end_gesture, lambda: live.create_checkpoint("a"),
             live.checkpoints, lambda: live.lock("shot.usda"), lambda: live.unlock("shot.usda"),
             lambda: live.mute("shot.usda", "look.usda"), lambda: live.globally_muted("shot.usda"),
             live.layer_states, live.show_presence, live.hide_presence, live.presences,
             lambda: live.lost_work_as_layer(0, "shot.usda"), live.unsent_work,
             lambda: live.layer_name(stage.GetRootLayer()), lambda: live.wait(lambda: False, 0.1),
             lambda: live.create_layer("new.usda"), lambda: live.upload("/tmp/a.png", "a.png"),
             lambda: live.request_upload("/tmp/a.png", "a.png"), live.skipped_files, lambda: live.gesture().__enter__(),
             live.request_reload, lambda: live.revision, lambda: live.pending, lambda: live.id,
             lambda: live.cache_folder]
    refused = []
    for call in calls:
        with pytest.raises(usdlive.Error) as raised:
            call()
        if not isinstance(raised.value, NotInPortable):
            assert raised.value.code == "notConnected" and "was closed" in str(raised.value)
            refused.append(call)
    assert len(calls) - len(refused) == {"fast": 0, "portable": 2}[backend]
    assert not live.connected and live.closed


def test_close_from_an_event_handler(server):
    with connect(server, "bob") as bob:
        live = connect(server, "ada")
        live.open_layer("shot.usda")
        live.add_handler(lambda event: live.close() if isinstance(event, events.Committed) else None)
        bob.open_layer("shot.usda").comment = "hello"
        assert bob.flush()
        with pytest.raises(usdlive.Error, match="was closed"):
            live.wait(lambda: False, 20)


def test_calls_from_a_notice_handler_within_tick(server):
    with connect(server, "bob") as bob:
        live = connect(server, "ada")
        layer = live.open_layer("shot.usda")
        calls = {"flush": live.flush, "open_layer": lambda: live.open_layer("look.usda"), "save": live.save,
                 "close_layer": lambda: live.close_layer("shot.usda"),
                 "attach": lambda: live.attach(Usd.Stage.CreateInMemory(), str(server.folder))}
        said: dict[str, str] = {}

        def changed(*_):
            live.tick()  # does nothing, because a tick calls it
            for name, call in calls.items():
                try:
                    call()
                    said[name] = "done"
                except usdlive.Error as error:
                    said[name] = str(error)
            live.close()

        listener = Tf.Notice.Register(Sdf.Notice.LayersDidChangeSentPerLayer, changed, layer)
        bob.open_layer("shot.usda").comment = "hello"
        assert bob.flush()
        with pytest.raises(usdlive.Error, match="was closed"):
            live.wait(lambda: False, 20)
        del listener
        assert set(said) == set(calls)
        for name, sentence in said.items():
            assert f"{name}()" in sentence and "notice handler" in sentence, (name, sentence)
        assert bob.open_layer("shot.usda").comment == "hello"


def test_one_layer_and_two_connections(server):
    stage = Usd.Stage.Open(str(server.folder / "shot.usda"))
    with connect(server, "ada") as ada, connect(server, "bob") as bob:
        ada.attach(stage)
        with pytest.raises(usdlive.Error, match="shot.usda is already live through another connection"):
            bob.attach(stage)
        with usdlive.connect(server.url, user="cy", cache_folder=str(server.folder), addresses=False) as cy:
            with pytest.raises(usdlive.Error, match="already live through another connection"):
                cy.open_layer("shot.usda")
        # Each editor has its own copy.
        copy = bob.open_stage("shot.usda")
        copy.GetPrimAtPath("/World").GetAttribute("x").Set(7.0)
        assert bob.flush()
        wait(lambda: stage.GetPrimAtPath("/World").GetAttribute("x").Get() == 7.0, ada)
    # The first editor has closed it: no lost work is reported, because nothing was written since.
    with connect(server, "bob") as bob:
        lost = collected(bob, events.Lost)
        bob.attach(stage)
        stage.GetPrimAtPath("/World").GetAttribute("x").Set(8.0)
        assert bob.flush()
        assert not lost


def in_thread(function) -> list[str]:
    said: list[str] = []

    def work():
        try:
            function()
            said.append("done")
        except (usdlive.Error, Tf.ErrorException) as error:
            said.append(str(error))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    return said


def test_calls_and_edits_from_another_thread(server):
    with connect(server, "ada") as live:
        layer = live.open_layer("shot.usda")
        for name, call in (("tick", live.tick), ("flush", live.flush), ("close", live.close),
                           ("open_layer", lambda: live.open_layer("look.usda")), ("lock", lambda: live.lock("shot.usda"))):
            (sentence,) = in_thread(call)
            assert f"{name}()" in sentence and "another thread" in sentence
        lost = collected(live, events.Lost)
        layer.comment = "mine"
        for edit in (lambda: setattr(layer.GetAttributeAtPath("/World.x"), "default", 5.0),
                     lambda: Sdf.CreatePrimInLayer(layer, "/World/Theirs")):
            (sentence,) = in_thread(edit)
            assert "another thread" in sentence and "shot.usda" in sentence
        assert live.flush()
        (one,) = lost
        assert "another thread" in one.message and {edit.path for edit in one.edits} == {"/World.x", "/World/Theirs"}
        kept = live.lost_work_as_layer(one.index, "shot.usda")
        assert kept.GetAttributeAtPath("/World.x").default == 5.0 and kept.GetPrimAtPath("/World/Theirs")
        assert layer.GetAttributeAtPath("/World.x").default == 0.0 and not layer.GetPrimAtPath("/World/Theirs")
        assert layer.comment == "mine"
    assert "mine" in run("cat", f"{server.url}/shot.usda")


def test_a_script_that_ends_without_close_loses_nothing(server, tmp_path):
    script = ("import sys, usdlive\n"
              "live = usdlive.connect(sys.argv[1], user='ada')\n"
              "live.open_layer('shot.usda').comment = 'written at last'\n")
    done = subprocess.run([sys.executable, "-c", script, server.url], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    with connect(server, "bob") as bob:
        assert bob.open_layer("shot.usda").comment == "written at last"
    gone = script + "input('written')\n"
    with subprocess.Popen([sys.executable, "-c", gone.replace("at last", "offline"), server.url], text=True,
                          stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                          env={**os.environ, "XDG_STATE_HOME": str(tmp_path)}) as left:
        assert left.stdout.read(7) == "written"
        server.stop()
        _, said = left.communicate("\n", 60)
    assert left.returncode == 0 and "were not sent; they are kept in" in said, said


def test_the_version_is_that_of_the_program():
    assert usdlive.__version__ in run("--version")


def test_save_returns_when_the_file_is_written(server):
    with connect(server, "ada") as live:
        live.open_layer("shot.usda").comment = "saved"
        saved = live.save()
        assert saved.saved == ("shot.usda",) and not saved.failed
        assert "saved" in (server.folder / "shot.usda").read_text()
        answers = collected(live, events.Saved)
        request = live.request_save()
        assert live.wait(lambda: answers) and answers[0].request == request
        server.stop()
        wait(lambda: not live.connected, live)
        with pytest.raises(usdlive.Error, match="nothing was saved"):
            live.open_layer("shot.usda").comment = "later"
            live.save(timeout=0.2)
        with pytest.warns(RuntimeWarning, match="1 edit of .* ago, on shot.usda, were not sent; they are kept in "):
            left = live.close(timeout=0)
        assert left.edits == 1


def test_unsent_work_is_offered_to_the_next_connection(server):
    live = connect(server, "ada")
    layer = live.open_layer("shot.usda")
    server.kill()
    live.begin_gesture()
    layer.GetAttributeAtPath("/World.x").default = 3.0
    with pytest.raises(usdlive.Error, match="were not sent; they are kept in"):
        with live:
            Sdf.CreatePrimInLayer(layer, "/World/New")
            started = time.monotonic()
    assert time.monotonic() - started < 15
    server.start()
    with connect(server, "ada") as later:
        found = collected(later, events.UnsentFound)
        later.tick()
        assert found and found[0].work[0].layers == ("shot.usda",)
        (work,) = later.unsent_work()
        assert work.as_layer("shot.usda").GetPrimAtPath("/World/New")
        assert work.send() == (1, 0, 0)
        assert later.unsent_work() == []
        layer = later.open_layer("shot.usda")
        assert layer.GetAttributeAtPath("/World.x").default == 3.0 and layer.GetPrimAtPath("/World/New")
        with pytest.raises(usdlive.Error):
            work.send()
    with connect(server, "bob") as bob:
        assert bob.unsent_work() == []
