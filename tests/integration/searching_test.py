"""The history for programs: `Live.log()` and `Live.blame()` find what the commands find (docs/history.md)."""

import datetime
import json
import time

import pytest
from conftest import connect, error_elsewhere, run, wait
from pxr import Sdf
from reverting_test import ROOT

import usdlive


@pytest.fixture
def server(project, serve):
    (project / "root.usda").write_text(ROOT)
    (project / "other.usda").write_text('#usda 1.0\n\ndef "Other"\n{\n    double x = 0\n}\n')
    return serve(project)


@pytest.fixture(params=["fast", "portable"])
def two(server, request):
    """Commits of two users, with a rename between. The searches are those of each backend."""
    with connect(server, "ada", request.param) as ada, connect(server, "bo") as bo:
        layers = {one: one.open_layer("root.usda") for one in (ada, bo)}
        for one, edit in ((ada, lambda root: setattr(root.GetAttributeAtPath("/World/Ball.radius"), "default", 2.0)),
                          (bo, lambda root: root.SetTimeSample("/World/Ball.radius", 2, 20.0)),
                          (ada, lambda root: setattr(root.GetPrimAtPath("/World/Ball"), "name", "Planet")),
                          (bo, lambda root: setattr(root.GetAttributeAtPath("/World/Planet.radius"), "default", 3.0)),
                          (bo, lambda root: setattr(bo.open_layer("other.usda"), "comment", "x"))):
            edit(layers[one])
            assert one.flush()
            wait(lambda one=one: ada.revision == bo.revision == max(ada.revision, bo.revision), ada, bo)
        yield server, ada, bo


def printed(server, *words):
    """Returns the commits that the command finds, the newest first."""
    lines = [json.loads(one) for one in run("log", "--json", "-n", "5000", server.url, *words).splitlines()]
    return [(one["revision"], one["user"], [(edit["action"], edit["layer"], edit["path"]) for edit in one["edits"]])
            for one in reversed(lines)]


def found(live, **filters):
    return [(one.revision, one.user, [(edit.kind, edit.layer, edit.path) for edit in one.edits]) for one in live.log(**filters)]


def test_commits_have_the_label_of_their_group(two):
    """M18"""
    server, ada, bo = two
    root = ada.open_layer("root.usda")
    with ada.undo_group("Möve\nchairs"):
        root.comment = "1"
        ada.tick()
        root.GetPrimAtPath("/World").comment = "2"
        ada.tick()
    assert ada.flush()
    ada.begin_gesture()
    root.comment = "3"
    ada.end_gesture()
    assert ada.flush()
    ada.undo()
    with ada.undo_group("x" * 5000):
        root.comment = "4"
    ada.undo()
    ada.redo()
    assert ada.flush()
    wait(lambda: bo.revision == ada.revision, bo)
    labels = [one.label for one in bo.log(limit=7)]
    assert labels == [f"Redo: {'x' * 994}", f"Undo: {'x' * 994}", "x" * 1000, "Undo: Edit", "", "Möve chairs", "Möve chairs"]
    assert [one.label for one in bo.log(label="CHAIRS")] == ["Möve chairs"] * 2
    assert found(bo, label="chairs") == printed(server, "--label", "chairs")
    text = run("log", server.url, "--label", "chairs")
    assert text.count("Möve chairs") == 2
    chairs = next(bo.log(label="chairs")).revision
    before = bo.revision
    run("revert", server.url, str(chairs))
    wait(lambda: bo.revision > before, bo)
    assert next(bo.log()).label == f"Revert of revision {chairs}"


def test_the_log_is_that_of_the_command(two):
    server, ada, _ = two
    for filters, words in [({}, []), ({"by": "bo"}, ["--by", "bo"]), ({"by": ["bo", "ada"]}, ["--by", "bo", "--by", "ada"]),
                           ({"kind": "animation"}, ["--kind", "animation"]), ({"layer": "root.usda"}, ["root.usda"]),
                           ({"layer": "root.usda", "path": "/World/Planet"}, ["--path", "/World/Planet", "root.usda"]),
                           ({"since": "1h"}, ["--since", "1h"]), ({"until": "1h"}, ["--until", "1h"]),
                           ({"by": "nobody"}, ["--by", "nobody"])]:
        assert found(ada, **filters) == printed(server, *words), filters
    paths = [edit.path for one in ada.log(layer="root.usda", path="/World/Planet") for edit in one.edits]
    assert paths == ["/World/Planet.radius", "/World/Ball", "/World/Ball.radius", "/World/Ball.radius"]
    imports = [one for one in ada.log() if one.imported]
    assert [one.imported for one in imports] == ["other.usda", "root.usda"] and not imports[0].edits


def test_times_limits_and_pages(two):
    server, ada, bo = two
    newest = next(ada.log())
    assert newest.user == "bo" and abs(newest.time - time.time()) < 60 and newest.client == bo.id
    assert len(list(ada.log(limit=2))) == 2 and list(ada.log(limit=0)) == []
    for since in (time.time() - 3600, datetime.datetime.now() - datetime.timedelta(hours=1), datetime.timedelta(hours=1), "1h",
                  datetime.datetime.now(datetime.timezone.utc) - datetime.timedelta(hours=1)):
        assert found(ada, since=since) == found(ada) and found(ada, until=since) == []
    ball = bo.open_layer("root.usda").GetAttributeAtPath("/World/Planet.radius")
    for number in range(1_300):
        ball.default = 10.0 + number
        bo.tick()
        while bo.pending > 500:
            bo.tick()
    bo.open_layer("root.usda").GetPrimAtPath("/World/Planet").name = "Moon"
    assert bo.flush()
    wait(lambda: ada.revision == bo.revision, ada)
    # Over pages, and a rename in the newest one.
    filters = {"layer": "root.usda", "path": "/World/Moon.radius", "by": "bo"}
    assert found(ada, **filters) == printed(server, "--path", "/World/Moon.radius", "--by", "bo", "root.usda")
    assert len(found(ada, **filters)) > 1_300
    # Commits that are made meanwhile are not in the log that was begun before.
    log = ada.log()
    first = next(log)
    bo.open_layer("root.usda").comment = "y"
    assert bo.flush()
    revisions = [first.revision, *(one.revision for one in log)]
    assert revisions == list(range(first.revision, 0, -1))


def test_blame_is_that_of_the_command(two):
    server, ada, _ = two
    for path, below in (("/World/Planet", False), ("/World", True), ("/World/Planet.radius.timeSamples", False)):
        [lines] = [json.loads(one) for one in run("blame", "--json", *(["-a"] if below else []), server.url, "root.usda",
                                                  path).splitlines()]
        ours = ada.blame("root.usda", path, below)
        assert [(one.path, one.field or "", one.revision, one.user, one.imported, one.value) for one in ours] == [
            (one["path"], one["field"], one["revision"], one["user"], one["imported"], one.get("value")) for one in lines]
        assert [(one.before_known, one.before) for one in ours] == [("before" in one, one.get("before")) for one in lines]
    made = {(one.path, one.field): one for one in ada.blame("root.usda", "/World/Planet")}
    radius = made["/World/Planet.radius", "default"]
    assert (radius.user, radius.value, radius.before, radius.before_known) == ("bo", 3.0, 2.0, True)
    assert made["/World/Planet", None].user == "ada" and made["/World/Planet", "typeName"].imported
    samples = ada.blame("root.usda", "/World/Planet.radius.timeSamples")
    assert [(one.part, one.value, one.user) for one in samples] == [(1.0, 10.0, ""), (2.0, 20.0, "bo")]
    # A layer that is not open here, and edits that are not committed.
    with connect(server, "cy", ada.backend) as cy:
        assert [(one.path, one.user) for one in cy.blame("root.usda", "/World/Planet.radius") if one.field == "default"] == [
            ("/World/Planet.radius", "bo")]
        assert cy.opened_layer("root.usda") is None
        cy.open_layer("root.usda").GetAttributeAtPath("/World/Planet.radius").default = 9.0
        [mine] = [one for one in cy.blame("root.usda", "/World/Planet.radius") if one.field == "default"]
        assert (mine.user, mine.value) in (("bo", 3.0), ("cy", 9.0))


def test_a_compacted_history_ends_at_its_base(two):
    server, ada, bo = two
    base = ada.create_checkpoint("base").revision
    bo.open_layer("root.usda").comment = "z"
    assert bo.flush()
    wait(lambda: ada.revision == bo.revision, ada)
    run("compact", server.url, "--days", "0")
    with connect(server, "cy", ada.backend) as later:
        for one in (ada, later):  # one was connected before the base was made
            assert [commit.revision for commit in one.log()] == [base + 1]
            opinions = one.blame("root.usda", "/World/Planet.radius")
            assert {(each.revision, each.user, each.before_known) for each in opinions} == {(0, "", False)}


def test_errors(two):
    server, ada, _ = two

    def code(call, *arguments, **options):
        with pytest.raises(usdlive.Error) as raised:
            list(call(*arguments, **options))
        return raised.value.code

    assert code(ada.log, path="/World") == code(ada.log, kind="taste") == code(ada.log, since="soon") == "invalidArgument"
    assert code(ada.log, limit=-1) == code(ada.log, since=object()) == "invalidArgument"
    assert code(ada.log, layer="root.usda", path="World//") == "invalidPath"
    assert code(ada.log, layer="none.usda") == code(ada.blame, "none.usda", "/World") == "layerNotFound"
    assert code(ada.blame, "root.usda", "/World/Ball") == "specNotFound"
    assert error_elsewhere(lambda: list(ada.log())).code == "invalidArgument"
    log = ada.log()
    server.stop()
    wait(lambda: not ada.connected, ada)
    assert code(lambda: log) == code(ada.blame, "root.usda", "/World") == "notConnected"
    server.start()
    wait(lambda: ada.connected, ada)
    log = ada.log(limit=5)
    ada.close()
    assert code(lambda: log) == code(ada.log) == "notConnected"
