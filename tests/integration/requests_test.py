"""Tests that each request ends once (RQ1), with a real server: every request that the client declares."""

import collections
import os
import signal

import pytest
from conftest import connect

import usdlive
from usdlive import _usdlive, events

FIELDS = {"createLayer": {"layer": "new.usda"}, "uploadFile": {"path": "a.png", "hash": "ab" * 32, "size": 3}, "createCheckpoint": {"name": "lunch"}, "compactHistory": {"days": 30}}


@pytest.fixture
def live(project, serve):
    (project / "shot.usda").write_text('#usda 1.0\ndef "World"\n{\n}\n')
    server = serve(project)
    with connect(server, "ada") as live:
        live.server = server
        live.open_layer("shot.usda")
        yield live


def ends_of(live: usdlive.Live, requests: list[int]) -> dict[int, list[events.Event]]:
    """Waits until each request has ended, and half a second longer for a second end."""
    ends = collections.defaultdict(list)

    def note(event: events.Event) -> None:
        if isinstance(event, (*events.ANSWERS, events.ServerError)) and event.request is not None:
            ends[event.request].append(event)

    live.add_handler(note)
    assert live.wait(lambda: ends.keys() >= set(requests), 20)
    live.wait(lambda: False, 0.5)
    live.remove_handler(note)
    return ends


def ask_all(live: usdlive.Live) -> list[int]:
    assert {"saveLayers", "createCheckpoint", "requestStorage", *FIELDS} <= set(_usdlive.REQUESTS)
    return [live.request(request, **FIELDS.get(request, {})) for request in _usdlive.REQUESTS]


def test_rq1_the_server_answers_every_request_once(live):
    requests = ask_all(live)
    ends = ends_of(live, requests)
    for name, request in zip(_usdlive.REQUESTS, requests, strict=True):
        assert len(ends[request]) == 1, name
        assert not isinstance(ends[request][0], events.ServerError), (name, ends[request])


def test_rq1_every_request_ends_with_the_connection(live):
    live.server.process.send_signal(signal.SIGSTOP)
    os.waitid(os.P_PID, live.server.process.pid, os.WSTOPPED)  # until then it may still answer
    requests = ask_all(live)
    live.tick()
    live.server.kill()
    ends = ends_of(live, requests)
    for request in requests:
        assert [error.code for error in ends[request]] == ["notConnected"]
    ends = ends_of(live, again := ask_all(live))
    for request in again:
        assert [error.code for error in ends[request]] == ["notConnected"], "there is no connection now"


def test_a_request_without_a_method_of_its_own(live):
    answer = live.ask("requestStorage")
    assert (answer.type, answer.fields["revision"]) == ("storage", live.revision)
    assert answer.fields["log"] > 0 and answer.fields["oldest"] > 1.7e9, "in seconds"
    assert [layer["layer"] for layer in answer.fields["layers"]] == ["shot.usda"]
    assert live.ask("listCheckpoints").checkpoints == ()


@pytest.mark.parametrize("request_, fields, code", [
    ("fly", {}, "invalidArgument"),
    ("createCheckpoint", {"nam": "lunch"}, "invalidArgument"),
    ("createCheckpoint", {"name": 7}, "invalidArgument"),
    ("createCheckpoint", {"request": 7}, "invalidArgument"),
    ("createCheckpoint", {}, "invalidArgument"),
    ("createLayer", {"layer": "../x.usda"}, "invalidLayerName"),
    ("createLayer", {}, "invalidLayerName"),
])
def test_a_wrong_request_is_an_error_and_harms_no_session(live, request_, fields, code):
    with pytest.raises(usdlive.Error) as raised:
        live.ask(request_, **fields)
    assert raised.value.code == code
    assert live.ask("listSkipped").count == 0
