"""Every request that names something which does not exist is an error: of the protocol, over HTTP, on the command line and in
Python. The tables have all of them."""

import asyncio
import inspect
import os
import pathlib
import re
import subprocess
import urllib.error
import urllib.parse
import urllib.request

import pytest
import wire
from cli_lines_test import LINES, LOCAL
from conftest import Server, connect
from layers_test import Scene

import usdlive
from pxr import Usd
from usdlive import _usdlive, events
from usdlive.omni.kit.usd.layers import LayerErrorType
from usdlive.portable import PortableLive

ROOT = pathlib.Path(__file__).parents[2]
NONE = "none.usda"


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    folder = tmp_path_factory.mktemp("projects") / "shots"
    folder.mkdir()
    for name in ("shot.usda", "other.usda", "locked.usda"):
        (folder / name).write_text('#usda 1.0\ndef "World"\n{\n}\n')
    server = Server(folder, folder.parent / "server.log").start()
    with connect(server, "ada") as live:
        stage = live.open_stage("shot.usda")
        for name in ("/One", "/Two"):
            stage.DefinePrim(name)
            assert live.flush()
        live.create_checkpoint("lunch")
    yield server
    assert server.stop() == 0, server.log.read_text()


# --- the protocol --------------------------------------------------------------------------------------

REQUESTS = {
    "openLayer": [({"layer": NONE, "revision": 0}, "layerNotFound"), ({"layer": NONE, "revision": 1}, "layerNotFound"),
                  ({"layer": "shot.usda", "revision": 999}, "futureRevision")],
    "requestLog": [({"from": 999, "to": 0}, "futureRevision"), ({"from": 0, "to": 999}, "futureRevision"),
                   ({"from": 2, "to": 1}, "invalidArgument")],
    "saveLayers": [({"layers": [NONE]}, "layerNotFound"), ({"layers": ["shot.usda", NONE], "force": True}, "layerNotFound")],
    "reloadLayers": [({"layers": [NONE]}, "layerNotFound"), ({"layers": ["shot.usda", NONE]}, "layerNotFound")],
    "uploadFile": [({"path": "a.png", "hash": "ab" * 32, "size": 3}, "not complete")],
}
NAME_NOTHING = {"listSkipped", "listCheckpoints", "compactHistory", "requestStorage", "createLayer", "createCheckpoint"}


def test_the_table_has_every_request():
    section = (ROOT / "docs" / "PROTOCOL.md").read_text().partition("| request | members |")[2].partition("\n## ")[0]
    assert set(re.findall(r"^\| (\w+) \|", section, re.MULTILINE)) == set(REQUESTS) | NAME_NOTHING
    assert set(_usdlive.REQUESTS) <= set(REQUESTS) | NAME_NOTHING


@pytest.mark.parametrize("request_, fields, code", [(name, *one) for name, all_ in REQUESTS.items() for one in all_])
def test_a_request_of_the_protocol(server, request_, fields, code):
    features = ["upload", "storage", "createLayer", "skipped"]
    with wire.Peer(server.url, features=features) as peer:
        peer.send(wire.control(request_, request=7, **fields))
        while True:
            kind, answer = peer.frame()
            if kind != "requestProgress" and answer.get("request") == 7:
                break
        if code == "not complete":  # by FI7 the answer that the value is not there
            assert answer["complete"] is False
        elif kind == "errorMessage":
            assert (answer["code"], answer["closing"]) == (code, False)
        else:
            assert [(one["layer"], one["code"]) for one in answer["failed"]] == [(NONE, code)]


def test_a_value_and_a_layer_of_a_transaction(server):
    with wire.Peer(server.url) as peer:
        peer.send(wire.control("requestBlob", hash="ab" * 32, offset=0))
        error = peer.expect_error()
        assert (error["code"], error["blob"]) == ("blobNotFound", "ab" * 32)
        peer.submit(1, NONE, wire.set_field("/World", "comment", wire.string("x")))
        assert peer.expect("Refusal")["code"] == "layerNotFound"
        # These have no answer: what they name is not open afterwards.
        peer.send(wire.control("closeLayer", layer=NONE))
        peer.send(wire.control("keepLayers", layers=[NONE]))
        peer.send(wire.control("listCheckpoints", request=8))
        assert [one["name"] for one in peer.expect("checkpoints")["checkpoints"]] == ["lunch"]


# --- HTTP ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("target", [
    "/files?revision=999", "/files?checkpoint=nope", "/nowhere/files", f"/files/{NONE}", "/files/none.png", "/nothing",
    "/shots/nothing", f"/shots/files/{NONE}", "/shots/files?revision=999", "/shots/files?checkpoint=nope"])
def test_an_address(server, target):
    with pytest.raises(urllib.error.HTTPError) as raised:
        urllib.request.urlopen(server.url.replace("ws://", "http://") + target)
    assert raised.value.code == 404
    assert len(raised.value.read().splitlines()) == 1


# --- the command line ----------------------------------------------------------------------------------

AT = [["shot.usda", "--revision", "999"], ["shot.usda", "--checkpoint", "nope"]]
WORDS = {
    "cat": [[NONE], *AT], "tree": [[NONE], *AT, *[["--composed", *one] for one in ([NONE], *AT)]],
    "dump": [["--composed", *one] for one in ([NONE], *AT, ["shot.usda", "--session", NONE])],
    "flatten": [[NONE], *AT, ["shot.usda", "--session", NONE]],
    "log": [[NONE], ["--from", "999"], ["shot.usda", "--from", "999"]], "watch": [[NONE]],
    "save": [[NONE], ["shot.usda", NONE]], "reload": [[NONE], ["shot.usda", NONE]], "upload": [["none.png", "a.png"]],
    "blame": [[NONE, "/World"], ["shot.usda", "/none"], ["shot.usda", "/World.none"]],
    "diff": [[NONE, "1"], ["shot.usda", "none"], ["shot.usda", "1", "none"], ["shot.usda", "99999"]],
    "revert": [["99999"], ["1-99999"], ["1", "--layer", NONE]], "restore": [["none"], ["1", NONE]],
    "mute": [[NONE, "shot.usda"], ["shot.usda", NONE]],
    "unmute": [[NONE, "shot.usda"], ["shot.usda", NONE]], "lock": [[NONE], ["locked.usda", NONE]],
    "unlock": [[NONE], ["locked.usda", NONE]], "session": [[verb, NONE] for verb in ("end", "restore", "delete", "merge", "update")]
    + [["create", "dusk", "--from", NONE]],
    "help": [["nothing"]], "completion": [["nothing"]]}
WITHOUT_NAMES = {"ls", "who", "checkpoints", "checkpoint", "compact", "stat", "serve", "forget", "join", "user", "access",
                 "grant", "deny", "revoke", "audit", "backup", "login", "page"}


def ended(*words):
    ran = subprocess.run([os.environ["USDLIVE_BIN"], *words], capture_output=True, text=True, timeout=60)
    return ran.returncode, ran.stderr


def test_the_table_of_what_is_not_there_has_every_verb():
    assert set(LINES) | set(LOCAL) == set(WORDS) | WITHOUT_NAMES


@pytest.mark.parametrize("verb, words", [(verb, one) for verb, all_ in WORDS.items() for one in all_])
def test_a_line(server, verb, words):
    code, error = ended(verb, *([] if verb in LOCAL else [server.url]), *words)
    assert code != 0 and error, (verb, words)
    assert re.search("none|nope|nothing|revision|shell", error), error


@pytest.mark.parametrize("verb", sorted((set(WORDS) | WITHOUT_NAMES) - set(LOCAL) - {"upload"}))
def test_a_line_for_a_project(server, verb):
    words = {"dump": ["--composed"]}.get(verb, []), LINES[verb]
    code, error = ended(verb, *words[0], f"{server.url}/nowhere", *words[1])
    assert code != 0 and "nowhere" in error


# --- Python --------------------------------------------------------------------------------------------


def origin(**names):
    stage = Usd.Stage.CreateInMemory()
    return lambda live: live.write_origin(stage.DefinePrim("/A"), **names)


def event(request, kind):
    """The request of a program that does not wait: it ends with an event, which this raises."""
    def call(live):
        ends = []
        live.add_handler(ends.append)
        number = request(live)
        live.wait(lambda: any(getattr(one, "request", None) == number for one in ends))
        end = next(one for one in ends if getattr(one, "request", None) == number)
        live.remove_handler(ends.append)
        assert isinstance(end, kind), end
        raise usdlive.Error(getattr(end, "code", ""), str(end))
    return call


CALLS = {
    "open_layer": [lambda live: live.open_layer(NONE)],
    "open_layer_async": [lambda live: asyncio.run(live.open_layer_async(NONE))],
    "open_stage": [lambda live: live.open_stage(NONE), lambda live: live.open_stage(NONE, at=1),
                   lambda live: live.open_stage("shot.usda", at="nope"),
                   lambda live: live.open_stage("shot.usda", at=999), lambda live: live.open_stage("shot.usda", at=0)],
    "player": [lambda live: live.player(NONE), lambda live: live.player("shot.usda", at="nope"),
               lambda live: live.player("shot.usda", at=999), lambda live: live.player("shot.usda", at=0)],
    "log": [lambda live: list(live.log(layer=NONE)), lambda live: live.log(since="nope"), lambda live: list(live.log(kind="nope"))],
    "blame": [lambda live: live.blame(NONE, "/World"), lambda live: live.blame("shot.usda", "/none"),
              lambda live: live.blame("shot.usda", "/World.none")],
    "open_stage_async": [lambda live: asyncio.run(live.open_stage_async(NONE))],
    "request_open_layer": [event(lambda live: live.request_open_layer(NONE), events.LayerOpenFailed)],
    "upload": [lambda live: live.upload("/none.png", "a.png")],
    "request_upload": [event(lambda live: live.request_upload("/none.png", "a.png"), events.UploadFailed)],
    "attach": [lambda live: live.attach(Usd.Stage.CreateInMemory(), "/nowhere")],
    "write_origin": [origin(layer=NONE), origin(checkpoint="nope"), origin(layer="shot.usda", checkpoint="nope")],
    "close_layer": [lambda live: live.close_layer(NONE), lambda live: live.close_layer("other.usda")],
    "save": [lambda live: live.save(NONE), lambda live: live.save("shot.usda", NONE)],
    "reload": [lambda live: live.reload(NONE)],
    "may_edit": [lambda live: live.may_edit(NONE)],
    "may_do": [lambda live: live.may_do("save", NONE), lambda live: live.may_do("nothing", "shot.usda")],
    "lock": [lambda live: live.lock(NONE), lambda live: live.lock("other.usda")],
    "unlock": [lambda live: live.unlock(NONE), lambda live: live.unlock("other.usda")],
    "mute": [lambda live: live.mute(NONE, "shot.usda"), lambda live: live.mute("shot.usda", NONE),
             lambda live: live.mute("other.usda", "shot.usda")],
    "unmute": [lambda live: live.unmute(NONE, "shot.usda"), lambda live: live.unmute("shot.usda", NONE)],
    "globally_muted": [lambda live: live.globally_muted(NONE), lambda live: live.globally_muted("other.usda")],
    "lost_work_as_layer": [lambda live: live.lost_work_as_layer(77, "shot.usda"), lambda live: live.lost_work_as_layer(0, NONE)],
    "request": [lambda live: live.request("nothing")],
    "ask": [lambda live: live.ask("nothing")],
}
# A query, which returns None or the name; new things; a user who may come later; ends as `save` and `reload` do.
ARE_NO_REQUESTS = {"opened_layer", "layer_name", "identifier", "create_layer", "create_checkpoint", "request_checkpoint",
                   "follow", "request_save", "request_reload"}


def test_the_table_has_every_call():
    named = {"layer", "layers", "root", "file", "name", "checkpoint", "user", "project_folder", "index", "request"}
    calls = {name for name, one in inspect.getmembers(usdlive.Live, inspect.isfunction)
             if not name.startswith("_") and named & set(inspect.signature(one).parameters)}
    assert calls == set(CALLS) | ARE_NO_REQUESTS


@pytest.mark.parametrize("backend, name, number", [
    (backend, name, number) for backend in ("fast", "portable") for name, all_ in CALLS.items() for number in range(len(all_))
    if backend == "fast" or hasattr(PortableLive, name) and name != "open_stage"])
def test_a_call(server, backend, name, number):
    with connect(server, "ada", backend) as live:
        live.open_layer("shot.usda")
        before = live.revision
        try:
            answer = CALLS[name][number](live)
        except usdlive.Error as error:
            assert re.search("none|nope|nothing|nowhere|other.usda|lost work|no revision", str(error)), error
        else:
            assert [(one.layer, one.code) for one in answer.failed] == [(NONE, "layerNotFound")]
        assert live.flush() and (live.revision == before or name in ("save", "reload")), "nothing was written"


def kit_calls(scene):
    kit = scene.layers
    parts = kit.get_layers_state(), kit.get_auto_authoring(), kit.get_specs_linking(), kit.get_specs_locking()
    for call in (call for part in parts for _, call in inspect.getmembers(part, inspect.ismethod)):
        given = {"layer_identifier": scene.weak.identifier, "spec_path": "/A", "muted": True, "locked": True, "name": "x"}
        taken = [name for name, one in inspect.signature(call).parameters.items()
                 if one.default is inspect.Parameter.empty or name == "layer_identifier"]
        for name, wrong in {"layer_identifier": NONE, "spec_path": "/None"}.items():
            if name in taken and not call.__name__.startswith("_"):
                yield call, {one: wrong if one == name else given[one] for one in taken}


def test_a_call_of_kits_layers(tmp_path):
    """It answers False, or sets the last error."""
    scene, count = Scene(tmp_path), 0
    for call, arguments in kit_calls(scene):
        scene.layers.get_layers_state().is_layer_writable(scene.root.identifier)
        assert scene.layers.get_last_error_type() == LayerErrorType.SUCCESS
        answer, count = call(**arguments), count + 1
        assert answer is False or scene.layers.get_last_error_type() != LayerErrorType.SUCCESS, (call, arguments, answer)
        assert not answer or call.__name__ == "get_layer_name"
    assert count > 25


def test_a_mute_of_a_layer_that_left_the_project_can_be_removed(serve, project):
    for name in ("shot.usda", "gone.usda"):
        (project / name).write_text("#usda 1.0\n")
    server = serve(project)
    with connect(server, "ada") as live:
        live.open_layer("shot.usda")
        live.mute("shot.usda", "gone.usda")
        assert live.flush()
        live.save()
    server.stop()
    (project / "gone.usda").unlink()
    server.start()
    with connect(server, "ada") as live:
        live.open_layer("shot.usda")
        assert "gone.usda" not in live.layers() and live.globally_muted("shot.usda") == ["gone.usda"]
        live.unmute("shot.usda", "gone.usda")
        assert live.globally_muted("shot.usda") == []
        with pytest.raises(usdlive.Error, match=r"no layer gone.usda"):
            live.mute("shot.usda", "gone.usda")
