"""Tests what viewers of the page see of live sessions, and do with them."""

from __future__ import annotations

import contextlib
import re
import shlex
import types
import typing

import pytest
import usdlive
from conftest import cat, connect, run, without_answers
from pxr import Sdf

ROOT = """#usda 1.0

def Xform "World"
{
    int number = 0

    def Sphere "Ball"
    {
        double radius = 1
    }

    def Sphere "Gone"
    {
        double radius = 5
    }
}
"""


@pytest.fixture
def served(project, serve):
    (project / "root.usda").write_text(ROOT)
    return serve(project)


@pytest.fixture
def opened(served, gateway, page):
    return page(gateway(served), {"name": "vera"})


def listed(page) -> dict[str, dict]:
    return {one["name"]: one for one in page.ask("sessions")["items"]}


@contextlib.contextmanager
def two_lines(served, page) -> typing.Iterator[tuple[usdlive.Live, Sdf.Layer, usdlive.Live, Sdf.Layer]]:
    """ada is in the main line and bo in the new session dusk, each with root.usda."""
    page.ask("createSession", name="dusk")
    with connect(served, "ada") as ada, usdlive.connect(f"{served.url}?session=dusk", user="bo") as bo:
        yield ada, ada.open_layer("root.usda"), bo, bo.open_layer("root.usda")


def write(live: usdlive.Live, layer: Sdf.Layer, **values: object) -> None:
    """Sets attributes of /World by name, with one commit."""
    for name, value in values.items():
        layer.GetAttributeAtPath(f"/World{'.' if name == 'number' else '/Ball.'}{name}").default = value
    assert live.flush(20)


def test_sessions_are_listed_created_ended_restored_and_deleted(opened, served, gateway, page):
    assert listed(opened) == {} and opened.messages["welcome"]["session"] == ""
    made = opened.ask("createSession", name="dusk's idea")
    assert (made["name"], made["creator"], made["ended"], made["merged"], made["problem"]) == ("dusk's idea", "vera", False, 0, "")
    assert made["revision"] > 0 and made["at"] > 1.7e9
    # A shell reads the name as one word, whatever is in it.
    program, verb, option, address = shlex.split(made["command"])
    assert (program, verb, option) == ("usdlive", "page", "--open")
    with usdlive.connect(address, user="bo") as bo:
        assert bo.layers() == ["root.usda"]
    other = page(gateway(served), {"name": "wim"})
    assert listed(other) == {"dusk's idea": made}
    with pytest.raises(RuntimeError, match="invalidArgument.*end it first"):
        opened.ask("deleteSession", name="dusk's idea")
    assert other.ask("endSession", name="dusk's idea")["ended"] and listed(opened)["dusk's idea"]["ended"]
    assert not opened.ask("restoreSession", name="dusk's idea")["ended"]
    opened.ask("endSession", name="dusk's idea")
    assert opened.ask("deleteSession", name="dusk's idea")["name"] == "dusk's idea" and listed(other) == {}


@pytest.mark.parametrize("fields, why", [
    ({"name": "a/b"}, "cannot have the name \"a/b\""), ({"name": ""}, "it is empty"), ({"name": ".dusk"}, "begins with a dot"),
    ({"name": "é" * 51}, "more than 100 bytes"), ({"name": "dusk"}, "there is a live session dusk"), ({"name": 5}, "'name' must be"),
    ({"name": "\ud800"}, "'name' must be"), ({"name": "x", "revision": -1}, "'revision' must be"),
    ({"name": "x", "revision": 99}, "there is no revision 99")])
def test_a_wrong_name_or_revision_is_refused_with_the_reason(opened, fields, why):
    opened.ask("createSession", name="dusk")
    with pytest.raises(RuntimeError, match=f"invalidArgument.*{re.escape(why)}"):
        opened.ask("createSession", **fields)
    assert list(listed(opened)) == ["dusk"]


def test_a_session_begins_with_the_revision_that_is_asked_for(opened, served):
    with connect(served, "ada") as ada:
        layer = ada.open_layer("root.usda")
        write(ada, layer, number=1)
        former = ada.revision
        write(ada, layer, number=2)
    assert opened.ask("createSession", name="dusk", revision=former)["revision"] == former
    assert "int number = 1" in run("cat", f"{served.url}/root.usda?session=dusk")


def test_a_merge_is_tried_first_and_then_does_what_was_decided(opened, served):
    with two_lines(served, opened) as (ada, main, bo, idea):
        write(bo, idea, number=22, radius=7)
        write(ada, main, number=11)
        dry = opened.ask("mergeSession", name="dusk", dryRun=True)
        assert (dry["revision"], dry["edits"], dry["created"], dry["dropped"]) == (0, 1, [], 0)
        assert dry["lines"] == ["root.usda set /World/Ball.radius default"]
        [conflict] = dry["conflicts"]
        assert dry["conflictCount"] == 1 and conflict | {"id": ""} == {
            "id": "", "what": "value", "layer": "root.usda", "path": "/World.number", "field": "default", "part": None, "before": "0",
            "main": "11", "session": "22", "deletedIn": None, "reason": "", "mainUser": "ada", "sessionUser": "bo"}
        # Without `dryRun` it is one, too.
        assert opened.ask("mergeSession", name="dusk", takes={conflict["id"]: "session"})["revision"] == 0
        with pytest.raises(RuntimeError, match="1 conflict is not decided"):
            opened.ask("mergeSession", name="dusk", dryRun=False)
        # A decision is for what was shown: somebody has written something else since.
        write(ada, main, number=12)
        with pytest.raises(RuntimeError, match="1 conflict is not decided"):
            opened.ask("mergeSession", name="dusk", dryRun=False, takes={conflict["id"]: "session"})
        assert "int number = 12" in cat(served, "root.usda") and not listed(opened)["dusk"]["ended"]
        [conflict] = opened.ask("mergeSession", name="dusk")["conflicts"]
        done = opened.ask("mergeSession", name="dusk", dryRun=False, keep=True, takes={conflict["id"]: "session"})
        assert done["edits"] == 2 and "int number = 22" in cat(served, "root.usda") and "radius = 7" in cat(served, "root.usda")
        commit = opened.ask("log", limit=1)["commits"][0]
        assert (commit["revision"], commit["user"], commit["text"]) == (done["revision"], "vera", "Merge dusk")
        assert not listed(opened)["dusk"]["ended"] and listed(opened)["dusk"]["merged"] == 0
        write(bo, idea, radius=8)
        done = opened.ask("mergeSession", name="dusk", dryRun=False)
    assert listed(opened)["dusk"]["ended"] and listed(opened)["dusk"]["merged"] == done["revision"]
    with pytest.raises(RuntimeError, match="merged in #"):
        opened.ask("mergeSession", name="dusk")


def test_one_side_can_be_taken_in_all_conflicts(opened, served):
    with two_lines(served, opened) as (ada, main, bo, idea):
        write(bo, idea, number=22, radius=7)
        write(ada, main, number=11, radius=3)
        dry = opened.ask("mergeSession", name="dusk", others="main")
        number = next(one["id"] for one in dry["conflicts"] if one["path"] == "/World.number")
        opened.ask("mergeSession", name="dusk", dryRun=False, takes={number: "session"}, others="main")
    assert "int number = 22" in cat(served, "root.usda") and "radius = 3" in cat(served, "root.usda")


def test_an_update_brings_the_main_line_to_a_session(opened, served):
    with two_lines(served, opened) as (ada, main, bo, idea):
        write(ada, main, radius=3)
        main.GetPrimAtPath("/World/Ball").customData = {"note": "from ada"}
        Sdf.CreatePrimInLayer(main, "/World/New").specifier = Sdf.SpecifierDef
        del main.GetPrimAtPath("/World").nameChildren["Gone"]
        assert ada.flush(20)
        idea.GetAttributeAtPath("/World/Gone.radius").default = 6
        assert bo.flush(20)
        dry = opened.ask("updateSession", name="dusk")
        [conflict] = dry["conflicts"]
        assert (conflict["what"], conflict["path"], conflict["deletedIn"]) == ("deleted", "/World/Gone", "main")
        assert "root.usda create /World/New" in dry["lines"]
        opened.ask("updateSession", name="dusk", dryRun=False, takes={conflict["id"]: "session"})
        text = run("cat", f"{served.url}/root.usda?session=dusk")
        assert "radius = 3" in text and "radius = 6" in text and "New" in text
        assert opened.ask("updateSession", name="dusk")["edits"] == 0


@pytest.mark.parametrize("fields", [{"takes": []}, {"takes": {"x": "both"}}, {"takes": {"x": None}}, {"others": "both"}, {"others": []}])
def test_decisions_that_are_none_are_refused(opened, fields):
    opened.ask("createSession", name="dusk")
    with pytest.raises(RuntimeError, match="invalidArgument"):
        opened.ask("mergeSession", name="dusk", dryRun=False, **fields)
    assert not listed(opened)["dusk"]["ended"]


def test_a_page_of_a_session_says_so_and_lists_all(opened, served, gateway, page):
    opened.ask("createSession", name="dusk + dawn")
    at = next(iter(listed(opened).values()))["command"]
    other = page(gateway(types.SimpleNamespace(url=shlex.split(at)[-1])), {"name": "wim"})
    assert (other.messages["welcome"]["project"], other.messages["welcome"]["session"]) == ("project", "dusk + dawn")
    assert opened.messages["welcome"]["project"] == "project"
    other.ask("createSession", name="night")
    assert listed(other) == listed(opened) and set(listed(opened)) == {"dusk + dawn", "night"}
    with connect(served, "ada") as ada:
        write(ada, ada.open_layer("root.usda"), radius=3)
    other.ask("updateSession", name="dusk + dawn", dryRun=False)
    other.wait(lambda page: abs(page.drawn(page.at("/World/Ball"))[:, 0]).max() == pytest.approx(3))
    # Its gateway is disconnected when it is ended, and finds it again.
    opened.ask("endSession", name="dusk + dawn")
    other.wait(lambda page: not page.messages["state"]["connected"])
    assert listed(other)["dusk + dawn"]["ended"]
    other.ask("restoreSession", name="dusk + dawn")
    other.wait(lambda page: page.messages["state"]["connected"], timeout=60)


def test_a_server_that_does_not_answer_holds_up_no_other_request(opened, served):
    with without_answers(served):
        opened.send({"type": "sessions", "id": "list"})
        opened.send({"type": "createSession", "id": "create", "name": "dusk"})
        assert opened.ask("children", path="/World")["total"] == 2
        assert not any(one["id"] in ("list", "create") for one in opened.all if one["type"] == "reply")
    opened.wait(lambda page: {"list", "create"} <= {one["id"] for one in page.all if one["type"] == "reply"})
    assert "dusk" in listed(opened)
