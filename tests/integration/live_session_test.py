"""Live sessions: lines of history beside the main line of a project, and their merge (LV1-LV6)."""

from __future__ import annotations

import contextlib
import json
import os
import pathlib
import signal
import subprocess
import sys
import threading
import typing
import urllib.error
import urllib.request
from random import Random

import page_client
import pytest
import usdlive
from conftest import cat, connect, refused, run, wait
from documents import blocks
from pxr import Ar, Gf, Sdf, Vt

ROOT = """#usda 1.0

def Xform "World"
{
    int number = 0
    float3[] points

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
BIG = 300_000  # points; a big value
MERGE = ("session", "merge")
FAULTY = pathlib.Path(os.environ["USDLIVE_BUILD"]) / "bin" / "usdlive-server-faults"
KILLED = 9  # the exit status with which Faults.h ends the process


@pytest.fixture
def project(project):
    (project / "root.usda").write_text(ROOT)
    return project


def at(server, name: str) -> str:
    return f"{server.url}?session={name}"


def join(server, name: str, user: str) -> usdlive.Live:
    return usdlive.connect(at(server, name), user=user, application="test")


def listed(server) -> dict[str, dict]:
    return {one["name"]: one for one in json.loads(run("session", "list", server.url, "--json"))}


def posted(server, path: str) -> tuple[int, str]:
    request = urllib.request.Request(server.url.replace("ws://", "http://") + path, method="POST")
    try:
        with urllib.request.urlopen(request) as answer:
            return answer.status, answer.read().decode()
    except urllib.error.HTTPError as error:
        return error.code, error.read().decode()


def moved(layer: Sdf.Layer, before: str, after: str) -> None:
    batch = Sdf.BatchNamespaceEdit()
    batch.Add(before, after or Sdf.Path.emptyPath)
    assert layer.Apply(batch)


@contextlib.contextmanager
def two_lines(server) -> typing.Iterator[tuple[usdlive.Live, Sdf.Layer, usdlive.Live, Sdf.Layer]]:
    """ada is in the main line and bo in the new session dusk, each with root.usda: `layer` and `idea`."""
    with connect(server, "ada") as ada:
        layer = ada.open_layer("root.usda")
        assert ada.flush(20)
        run("session", "create", server.url, "dusk")
        with join(server, "dusk", "bo") as bo:
            yield ada, layer, bo, bo.open_layer("root.usda")


def test_lv1_a_live_session_goes_its_own_way(project, serve):
    server = serve(project)
    with connect(server, "ada") as ada:
        layer = ada.open_layer("root.usda")
        layer.GetAttributeAtPath("/World.number").default = 1
        layer.GetAttributeAtPath("/World.points").default = Vt.Vec3fArray(BIG, Gf.Vec3f(1, 2, 3))
        assert ada.flush(20)
        assert "from #" in run("session", "create", server.url, "dusk", "--user", "bo")
        with join(server, "dusk", "bo") as bo, join(server, "dusk", "cy") as cy:
            idea, seen = bo.open_layer("root.usda"), cy.open_layer("root.usda")
            assert len(idea.GetAttributeAtPath("/World.points").default) == BIG, "big values are there, too"
            idea.GetAttributeAtPath("/World.number").default = 2
            layer.GetAttributeAtPath("/World.number").default = 3
            assert bo.flush(20) and ada.flush(20)
            assert cy.wait(lambda: seen.GetAttributeAtPath("/World.number").default == 2, 20)
            people = run("who", at(server, "dusk"))
            assert "bo" in people and "cy" in people and "ada" not in people
            assert layer.GetAttributeAtPath("/World.number").default == 3
        assert "int number = 3" in cat(server, "root.usda")
    # Both go on after the server, each with its history.
    server.stop()
    server.start()
    assert "int number = 3" in cat(server, "root.usda")
    assert "int number = 2" in run("cat", f"{server.url}/root.usda?session=dusk")
    assert "bo" in run("log", at(server, "dusk")) and "bo" not in run("log", server.url)


def test_lv1_over_dds(project, serve, dds_domain):
    server = serve(project, "--dds", "--dds-domain", str(dds_domain))
    run("session", "create", server.url, "dusk")
    with usdlive.connect(f"dds://{project.name}?session=dusk", user="bo") as bo:
        layer = bo.open_layer("root.usda")
        layer.GetAttributeAtPath("/World.number").default = 2
        assert bo.flush(20)
    assert "int number = 2" in run("cat", f"{server.url}/root.usda?session=dusk")
    assert "int number = 0" in cat(server, "root.usda")


def test_lv2_a_live_session_writes_no_files(project, serve):
    server = serve(project)
    run("session", "create", server.url, "dusk")
    with join(server, "dusk", "bo") as bo:
        bo.open_layer("root.usda").GetAttributeAtPath("/World.number").default = 2
        bo.create_layer("new.usda")
        new = bo.open_layer("new.usda")
        Sdf.CreatePrimInLayer(new, "/New")
        assert bo.flush(20)
        assert "usdlive session merge" in str(bo.save("root.usda").failed)
        with pytest.raises(usdlive.Error, match="root.usda"):
            bo.create_layer("root.usda")
    assert (project / "root.usda").read_text() == ROOT
    assert not (project / "new.usda").exists()
    assert "New" in run("cat", f"{server.url}/new.usda?session=dusk")
    assert "new.usda" not in run("ls", server.url)


def test_lv1_a_stage_finds_its_layers_and_files(project, serve):
    """References and textures of a session are found under its name."""
    (project / "sets").mkdir()
    (project / "sets" / "room.usda").write_text('#usda 1.0\n(\n    defaultPrim = "Room"\n)\ndef "Room"\n{\n'
                                                '    asset picture = @../tex/brick.png@\n}\n')
    (project / "tex").mkdir()
    (project / "tex" / "brick.png").write_bytes(b"brick")
    server = serve(project)
    run("session", "create", server.url, "dusk")
    with join(server, "dusk", "bo") as bo, join(server, "dusk", "cy") as cy:
        stage, other = bo.open_stage("root.usda"), cy.open_stage("root.usda")
        stage.DefinePrim("/World/Room").GetReferences().AddReference("./sets/room.usda")
        assert bo.flush(20)
        for live, one in ((bo, stage), (cy, other)):
            def picture(one=one):
                return one.GetAttributeAtPath("/World/Room.picture")

            assert live.wait(lambda picture=picture: picture() and picture().Get().resolvedPath, 30)
            asset = Ar.GetResolver().OpenAsset(Ar.ResolvedPath(picture().Get().resolvedPath))
            assert bytes(asset.GetBuffer()) == b"brick"


def test_lv3_lv4_sessions_are_listed_ended_restored_and_deleted(project, serve):
    server = serve(project)
    assert "no live sessions" in run("session", "list", server.url)
    run("session", "create", server.url, "dusk", "--user", "bo")
    assert "choose another name" in refused("session", "create", server.url, "dusk")
    for name in ("", ".dusk", "a/b", "a\nb", "a?b", "x" * 101, "dusk.part"):
        assert "cannot have the name" in refused("session", "create", server.url, name), name
    dusk = listed(server)["dusk"]
    assert (dusk["creator"], dusk["ended"], dusk["merged"], dusk["url"]) == ("bo", False, 0, at(server, "dusk"))
    assert "end it first" in refused("session", "delete", server.url, "dusk")
    with join(server, "dusk", "bo") as bo:
        bo.open_layer("root.usda").GetAttributeAtPath("/World.number").default = 2
        assert bo.flush(20)
        assert listed(server)["dusk"]["users"] == ["bo"]
        with join(server, "dusk", "ann"), join(server, "dusk", "ann"), connect(server, "cy"):
            run("session", "create", server.url, "empty")
            assert {name: one["users"] for name, one in listed(server).items()} == {"dusk": ["ann", "bo"], "empty": []}
            assert ", in it: ann, bo  ws://" in run("session", "list", server.url)
            assert [one.users for one in usdlive.sessions(server.url).list()] == [("ann", "bo"), ()]
        run("session", "end", server.url, "empty")
        run("session", "delete", server.url, "empty")
        wait(lambda: listed(server)["dusk"]["users"] == ["bo"])
        run("session", "end", server.url, "dusk")
        assert listed(server)["dusk"]["users"] == []
        assert bo.wait(lambda: not bo.connected, 20)
        assert "ended already" in refused("session", "end", server.url, "dusk")
        assert "dusk" in refused("ls", at(server, "dusk"))
        run("session", "restore", server.url, "dusk")
        assert bo.wait(lambda: bo.connected, 20), "an editor finds it again by itself"
        bo.open_layer("root.usda").GetAttributeAtPath("/World.number").default = 3
        assert bo.flush(20)
    run("session", "end", server.url, "dusk")
    run("session", "delete", server.url, "dusk")
    assert listed(server) == {}
    assert not list((project / ".usdlive" / "sessions").iterdir())
    # Another one of this name is another history.
    run("session", "create", server.url, "dusk")
    assert "int number = 0" in run("cat", f"{server.url}/root.usda?session=dusk")


def test_lv4_requests_that_are_wrong(project, serve):
    server = serve(project)
    assert posted(server, "/sessions/dusk/create?user=bo")[0] == 200
    assert posted(server, f"/{project.name}/sessions/dawn/create")[0] == 200
    for path, status in {"/sessions/none/end": 404, "/sessions/dusk/fly": 404, "/nowhere/sessions/x/create": 404,
                         "/sessions/dusk": 400, "/sessions/x/create?what=1": 400, "/sessions/x/end?merged=x": 400,
                         "/sessions/%2e/create": 400, "/sessions/a%2fb/create": 400, "/sessions/dusk/create": 409}.items():
        code, body = posted(server, path)
        assert (code, len(body.splitlines())) == (status, 1), (path, code, body)
    with pytest.raises(urllib.error.HTTPError) as refused_get:
        urllib.request.urlopen(server.url.replace("ws://", "http://") + "/sessions/x/create")
    assert refused_get.value.code == 405
    assert set(listed(server)) == {"dusk", "dawn"}


def test_lv4_an_unfinished_session_does_not_exist(project, serve):
    server = serve(project)
    cat(server, "root.usda")
    server.stop()
    part = project / ".usdlive" / "sessions" / "half.part" / "store"
    part.mkdir(parents=True)
    server.start()
    assert listed(server) == {} and not part.exists()
    run("session", "create", server.url, "half")
    assert set(listed(server)) == {"half"}


def test_lv4_a_killed_server_has_the_whole_session(project, serve):
    server = serve(project)
    run("session", "create", server.url, "dusk")
    with join(server, "dusk", "bo") as bo:
        bo.open_layer("root.usda").GetAttributeAtPath("/World.number").default = 2
        assert bo.flush(20)
    server.process.send_signal(signal.SIGKILL)
    server.process.wait()
    server.start()
    assert "int number = 2" in run("cat", f"{server.url}/root.usda?session=dusk")


@pytest.mark.parametrize("point", ["live-session-before", "live-session-after"])
def test_lv4_a_server_that_dies_while_it_makes_a_session(point, project, serve):
    server = serve(project)
    with connect(server, "ada") as ada:
        ada.open_layer("root.usda").GetAttributeAtPath("/World.number").default = 1
        assert ada.flush(20)
    server.stop()
    product, server.program = server.program, [str(FAULTY)]
    server.environment = {"USDLIVE_FAULT": f"{point}:1"}
    server.start()
    assert refused("session", "create", server.url, "dusk")
    assert server.process.wait(timeout=20) == KILLED
    server.program, server.environment = product, {}
    server.start()
    assert listed(server) == {} and not list((project / ".usdlive" / "sessions").iterdir())
    run("session", "create", server.url, "dusk")
    assert "int number = 1" in run("cat", f"{server.url}/root.usda?session=dusk")


def test_lv4_a_full_disk_makes_no_session(small_disk, serve):
    disk = small_disk("64m")
    (disk / "project").mkdir()
    (disk / "project" / "root.usda").write_text(ROOT)
    server = serve(disk / "project")
    cat(server, "root.usda")
    ballast = disk / "ballast"
    with ballast.open("wb") as file, contextlib.suppress(OSError):
        while True:
            file.write(bytes(1 << 16))
    assert "full" in refused("session", "create", server.url, "dusk")
    assert listed(server) == {}
    ballast.unlink()
    run("session", "create", server.url, "dusk")
    assert set(listed(server)) == {"dusk"}


def test_lv5_a_damaged_session_concerns_nobody_else(project, serve):
    server = serve(project)
    run("session", "create", server.url, "dusk")
    server.stop()
    (project / ".usdlive" / "sessions" / "dusk" / "store" / "db" / "CURRENT").write_text("damaged")
    server.start()
    assert "int number = 0" in cat(server, "root.usda")
    assert "usdlive session delete" in listed(server)["dusk"]["error"]
    assert "cannot be opened" in run("session", "list", server.url)
    assert "damaged" in refused("ls", at(server, "dusk"))
    run("session", "end", server.url, "dusk")
    run("session", "delete", server.url, "dusk")
    assert listed(server) == {}


def test_lv6_a_merge_carries_a_session_through_what_happened(project, serve):
    server = serve(project)
    with connect(server, "ada") as ada:
        layer = ada.open_layer("root.usda")
        layer.GetAttributeAtPath("/World.number").default = 1
        assert ada.flush(20)
        run("session", "create", server.url, "dusk")
        with join(server, "dusk", "bo") as bo:
            idea = bo.open_layer("root.usda")
            idea.GetAttributeAtPath("/World/Ball.radius").default = 7
            idea.GetAttributeAtPath("/World.points").default = Vt.Vec3fArray(BIG, Gf.Vec3f(1, 2, 3))
            moved(idea, "/World/Gone", "/World/Kept")
            Sdf.CreatePrimInLayer(idea, "/World/Ball/Below").specifier = Sdf.SpecifierDef
            bo.create_layer("new.usda")
            Sdf.CreatePrimInLayer(bo.open_layer("new.usda"), "/New").specifier = Sdf.SpecifierDef
            assert bo.flush(20)
        moved(layer, "/World/Ball", "/World/Globe")
        layer.GetAttributeAtPath("/World/Gone.radius").default = 8
        assert ada.flush(20)
        dry = json.loads(run("session", "merge", server.url, "dusk", "--dry-run", "--json"))
        assert (dry["conflicts"], dry["created"], "revision" in dry) == ([], ["new.usda"], False)
        assert listed(server)["dusk"]["merged"] == 0 and "Kept" not in cat(server, "root.usda")
        done = json.loads(run("session", "merge", server.url, "dusk", "--json"))
        assert done["conflicts"] == [] and done["dropped"] == 0
        assert ada.wait(lambda: layer.GetPrimAtPath("/World/Kept"), 20)
        assert layer.GetAttributeAtPath("/World/Globe.radius").default == 7
        assert layer.GetPrimAtPath("/World/Globe/Below") and not layer.GetPrimAtPath("/World/Ball")
        assert layer.GetAttributeAtPath("/World/Kept.radius").default == 8, "the main line's own change is kept"
        points = layer.GetAttributeAtPath("/World.points")
        assert ada.wait(lambda: points.default == Vt.Vec3fArray(BIG, Gf.Vec3f(1, 2, 3)), 20)
    assert "New" in cat(server, "new.usda") and (project / "new.usda").exists()
    assert "Merge dusk" in run("log", server.url)
    dusk = listed(server)["dusk"]
    assert dusk["ended"] and dusk["merged"] == done["revision"]
    assert "merged in #" in refused("session", "merge", server.url, "dusk")
    # A save writes what was merged.
    run("save", server.url)
    assert "Kept" in (project / "root.usda").read_text()


def test_lv6_conflicts_are_decided_before_anything_is_merged(project, serve):
    server = serve(project)
    with two_lines(server) as (ada, layer, bo, idea):
        idea.GetAttributeAtPath("/World.number").default = 22
        idea.GetAttributeAtPath("/World/Ball.radius").default = 7
        idea.GetAttributeAtPath("/World/Gone.radius").default = 6
        assert bo.flush(20)
        layer.GetAttributeAtPath("/World.number").default = 11
        moved(layer, "/World/Gone", "")
        assert ada.flush(20)
        before = cat(server, "root.usda")
        said = subprocess.run([os.environ["USDLIVE_BIN"], *MERGE, server.url, "dusk", "--json"], capture_output=True, text=True)
        found = {one["path"]: one for one in json.loads(said.stdout)["conflicts"]}
        assert said.returncode == 1 and "2 conflicts are not decided" in said.stderr
        assert set(found) == {"/World.number", "/World/Gone"}
        number = found["/World.number"]
        assert (number["mainUser"], number["sessionUser"], number["take"]) == ("ada", "bo", "undecided")
        assert [number[side]["value"] if isinstance(number[side], dict) else number[side]
                for side in ("before", "main", "session")] == [0, 11, 22]
        assert cat(server, "root.usda") == before and not listed(server)["dusk"]["ended"]
        run(*MERGE, server.url, "dusk", "--take", "session", "--main", "/World.number")
        text = cat(server, "root.usda")
        assert "int number = 11" in text and "double radius = 7" in text
        assert "double radius = 6" in text, "the deleted prim is back, with the session's change"


class Writer:
    """An editor of a session that writes as fast as it can, until it is told to end."""

    def __init__(self, server):
        self.confirmed, self._ends = 0, threading.Event()
        self._thread = threading.Thread(target=self._run, args=(server,))
        self._thread.start()

    def _run(self, server):
        with join(server, "dusk", "bo") as bo:
            layer = bo.open_layer("root.usda")
            while not self._ends.is_set():
                layer.GetAttributeAtPath("/World.number").default = self.confirmed + 1
                if bo.flush(20):
                    self.confirmed += 1

    def end(self):
        self._ends.set()
        self._thread.join()


def test_lv6_what_is_written_during_a_merge_is_not_lost(project, serve):
    server = serve(project)
    run("session", "create", server.url, "dusk")
    writer = Writer(server)
    wait(lambda: writer.confirmed > 3)
    said = refused(*MERGE, server.url, "dusk", "--take", "session")
    assert "merge again" in said, said
    if listed(server)["dusk"]["ended"]:
        run("session", "restore", server.url, "dusk")
    before = writer.confirmed
    wait(lambda: writer.confirmed > before)
    writer.end()
    run(*MERGE, server.url, "dusk", "--take", "session")
    assert f"int number = {writer.confirmed}" in cat(server, "root.usda")


def test_lv6_a_session_can_go_on_after_a_merge(project, serve):
    server = serve(project)
    run("session", "create", server.url, "dusk")
    with join(server, "dusk", "bo") as bo:
        idea = bo.open_layer("root.usda")
        for radius in (7, 8):
            idea.GetAttributeAtPath("/World/Ball.radius").default = radius
            assert bo.flush(20)
            run("session", "merge", server.url, "dusk", "--keep", "--take", "session")
            assert f"double radius = {radius}" in cat(server, "root.usda")
        assert "nothing to be merged" in run("session", "merge", server.url, "dusk", "--keep")


def test_several_projects_have_their_own_sessions(tmp_path, serve):
    for name in ("one", "two"):
        (tmp_path / "all" / name).mkdir(parents=True)
        (tmp_path / "all" / name / "root.usda").write_text(ROOT)
    (tmp_path / "assets").mkdir()
    server = serve(tmp_path / "assets", "--projects", str(tmp_path / "all"))
    run("session", "create", f"{server.url}/one", "dusk")
    with usdlive.connect(f"{server.url}/one?session=dusk", user="bo") as bo:
        bo.open_layer("root.usda").GetAttributeAtPath("/World.number").default = 2
        assert bo.flush(20)
    assert "no live sessions" in run("session", "list", f"{server.url}/two")
    assert "int number = 2" in run("cat", f"{server.url}/one/root.usda?session=dusk")
    assert "dusk" in refused("ls", f"{server.url}/two?session=dusk")
    run("session", "merge", f"{server.url}/one", "dusk")
    assert "int number = 2" in run("cat", f"{server.url}/one/root.usda")


def test_the_page_shows_a_session(project, serve, tmp_path):
    """Also its edits are those of the session."""
    server = serve(project)
    run("session", "create", server.url, "dusk")
    with join(server, "dusk", "bo") as bo:
        layer = bo.open_layer("root.usda")
        Sdf.CreatePrimInLayer(layer, "/World/Idea").typeName = "Cube"
        layer.GetPrimAtPath("/World/Idea").specifier = Sdf.SpecifierDef
        assert bo.flush(20)
        gateway = page_client.Gateway(at(server, "dusk"), tmp_path).start()
        page = page_client.Page(gateway).opened()
        try:
            page.wait(lambda one: one.has("/World/Idea"))
        finally:
            page.close()
            assert gateway.stop() == 0
    assert "Idea" not in cat(server, "root.usda")


def radius(layer) -> float:
    return layer.GetAttributeAtPath("/World/Ball.radius").default


def number(layer) -> int:
    return layer.GetAttributeAtPath("/World.number").default


UPDATE = ("session", "update")
NOTHING = {"update": "nothing to be updated", "merge": "nothing to be merged"}


def nothing(server, verb: str, *options: str) -> bool:
    return NOTHING[verb] in run("session", verb, server.url, "dusk", *options)


def test_lv7_an_update_brings_the_main_lines_changes(project, serve):
    server = serve(project)
    with two_lines(server) as (ada, layer, bo, idea):
        idea.GetAttributeAtPath("/World/Ball.radius").default = 7
        moved(layer, "/World/Ball", "/World/Globe")
        layer.GetAttributeAtPath("/World.number").default = 3
        layer.GetAttributeAtPath("/World.points").default = Vt.Vec3fArray(BIG, Gf.Vec3f(1, 2, 3))
        ada.create_layer("new.usda")
        Sdf.CreatePrimInLayer(ada.open_layer("new.usda"), "/New").specifier = Sdf.SpecifierDef
        assert bo.flush(20) and ada.flush(20)
        dry = json.loads(run(*UPDATE, server.url, "dusk", "--dry-run", "--json"))
        assert (dry["conflicts"], dry["dropped"], dry["dryRun"], "revision" in dry) == ([], 0, True, False)
        assert {edit["layer"] for edit in dry["edits"]} == {"root.usda", "new.usda"}
        done = json.loads(run(*UPDATE, server.url, "dusk", "--json"))
        assert done["conflicts"] == [] and done["revision"] > 0
        assert bo.wait(lambda: idea.GetPrimAtPath("/World/Globe") and number(idea) == 3, 20)
        assert idea.GetAttributeAtPath("/World/Globe.radius").default == 7
        points = idea.GetAttributeAtPath("/World.points")
        assert bo.wait(lambda: points.default and len(points.default) == BIG, 20)
        assert "New" in run("cat", f"{server.url}/new.usda?session=dusk")
        assert "Update from the main line" in run("log", at(server, "dusk"))
        assert nothing(server, "update")
        assert "radius = 1" in cat(server, "root.usda"), "the main line is as it was"
        # Only what the session has changed itself is merged.
        merged = json.loads(run(*MERGE, server.url, "dusk", "--json"))
        assert [edit["path"] for edit in merged["edits"]] == ["/World/Globe.radius"]


def test_lv7_what_was_merged_twice_is_neither_a_conflict_nor_taken_back(project, serve):
    server = serve(project)
    with two_lines(server) as (ada, layer, bo, idea):
        idea.GetAttributeAtPath("/World/Ball.radius").default = 7
        layer.GetAttributeAtPath("/World.number").default = 3
        Sdf.CreatePrimInLayer(idea, "/World/New").specifier = Sdf.SpecifierDef
        assert bo.flush(20) and ada.flush(20)
        run(*UPDATE, server.url, "dusk")
        run(*MERGE, server.url, "dusk", "--keep")
        assert ada.wait(lambda: radius(layer) == 7 and layer.GetPrimAtPath("/World/New"), 20)
        # The main line goes on: the session, which has not changed it since, takes nothing back.
        layer.GetAttributeAtPath("/World/Ball.radius").default = 1
        moved(layer, "/World/New", "/World/Newer")
        assert ada.flush(20)
        assert nothing(server, "merge", "--keep")
        # A change of what was merged finds it under its new name.
        idea.GetPrimAtPath("/World/New").typeName = "Cube"
        assert bo.flush(20)
        run(*MERGE, server.url, "dusk", "--keep")
        assert ada.wait(lambda: layer.GetPrimAtPath("/World/Newer").typeName == "Cube", 20)
        assert radius(layer) == 1 and not layer.GetPrimAtPath("/World/New")
        run(*UPDATE, server.url, "dusk")
        assert bo.wait(lambda: radius(idea) == 1 and idea.GetPrimAtPath("/World/Newer"), 20)
        # Both change the same again: that is a conflict, with the contents since the last merge.
        idea.GetAttributeAtPath("/World/Ball.radius").default = 8
        layer.GetAttributeAtPath("/World/Ball.radius").default = 9
        assert bo.flush(20) and ada.flush(20)
        for verb in ("merge", "update"):
            said = json.loads(run("session", verb, server.url, "dusk", "--dry-run", "--json"))
            [one] = said["conflicts"]
            assert [one[side]["value"] if isinstance(one[side], dict) else one[side]
                    for side in ("before", "main", "session")] == [1, 9, 8]
            assert (one["mainUser"], one["sessionUser"]) == ("ada", "bo")
        assert "1 conflict is not decided" in refused(*UPDATE, server.url, "dusk")
        run(*UPDATE, server.url, "dusk", "--take", "main", "--session", "/World/Ball")
        assert radius(idea) == 8 and nothing(server, "update")
        run(*MERGE, server.url, "dusk")
        assert ada.wait(lambda: radius(layer) == 8, 20), "the decision is not asked for again"
        assert cat(server, "root.usda") == run("cat", f"{server.url}/root.usda") != ROOT


def test_lv7_a_decision_for_the_line_that_receives_is_kept(project, serve):
    """Nothing is committed then, and it counts all the same."""
    server = serve(project)
    with two_lines(server) as (ada, layer, bo, idea):
        idea.GetAttributeAtPath("/World.number").default = 2
        layer.GetAttributeAtPath("/World.number").default = 3
        assert bo.flush(20) and ada.flush(20)
        assert "nothing to be merged" in run(*MERGE, server.url, "dusk", "--keep", "--take", "main")
        assert nothing(server, "merge", "--keep")
        run(*UPDATE, server.url, "dusk")
        assert "int number = 3" in run("cat", f"{server.url}/root.usda?session=dusk")


def test_lv7_a_noted_merge_counts_if_it_was_committed(project, serve):
    """A merge notes itself before it commits. What has no commit was not done."""
    server = serve(project)
    run("session", "create", server.url, "dusk")
    with join(server, "dusk", "bo") as bo:
        bo.open_layer("root.usda").GetAttributeAtPath("/World.number").default = 2
        assert bo.flush(20)
    head = json.loads(run("log", at(server, "dusk"), "--json").splitlines()[0])["revision"]
    note = f"/sessions/dusk/note-merge?target=main&from={head}&into=0&client=nobody&known="
    assert posted(server, note + "0")[0] == 200
    code, body = posted(server, note + "0")
    assert code == 409 and "meanwhile" in body
    for wrong in ("target=both", "from=x", "known=-1", "client=" + "x" * 201):
        assert posted(server, f"/sessions/dusk/note-merge?{wrong}")[0] == 400, wrong
    assert posted(server, note.replace("dusk", "none") + "1")[0] == 404
    run(*MERGE, server.url, "dusk")
    assert "int number = 2" in cat(server, "root.usda")


def test_lv1_a_session_from_a_former_revision(project, serve):
    server = serve(project)
    with connect(server, "ada") as ada:
        layer = ada.open_layer("root.usda")
        layer.GetAttributeAtPath("/World.number").default = 1
        assert ada.flush(20)
        run("checkpoint", server.url, "approved", "--user", "ada")
        layer.GetAttributeAtPath("/World.number").default = 2
        moved(layer, "/World/Gone", "")
        moved(layer, "/World/Ball", "/World/Globe")
        Sdf.CreatePrimInLayer(layer, "/World/Later").specifier = Sdf.SpecifierDef
        ada.create_layer("later.usda")
        Sdf.CreatePrimInLayer(ada.open_layer("later.usda"), "/Later").specifier = Sdf.SpecifierDef
        assert ada.flush(20)
        before = cat(server, "root.usda")
        assert "no revision 999" in refused("session", "create", server.url, "dusk", "--from", "999")
        assert "no checkpoint 'no'" in refused("session", "create", server.url, "dusk", "--from", "no")
        assert posted(server, "/sessions/dusk/create?from=999")[0] == 409
        assert listed(server) == {}
        run("session", "create", server.url, "dusk", "--from", "approved")
        text = run("cat", f"{server.url}/root.usda?session=dusk")
        assert "number = 1" in text and "Ball" in text and "Gone" in text and "Later" not in text
        assert "Later" not in run("cat", f"{server.url}/later.usda?session=dusk")
        checkpoints = run("checkpoints", server.url)
        assert f"#{listed(server)['dusk']['revision']}" in checkpoints, checkpoints
        # The later changes of the main line are its own: they are neither taken back nor conflicts.
        assert nothing(server, "merge", "--keep")
        with join(server, "dusk", "bo") as bo:
            idea = bo.open_layer("root.usda")
            idea.GetAttributeAtPath("/World/Ball.radius").default = 7
            assert bo.flush(20)
            run(*MERGE, server.url, "dusk", "--keep")
            assert ada.wait(lambda: layer.GetAttributeAtPath("/World/Globe.radius").default == 7, 20)
            assert cat(server, "root.usda").replace("radius = 7", "radius = 1") == before
            run(*UPDATE, server.url, "dusk")
            assert bo.wait(lambda: idea.GetPrimAtPath("/World/Later") and number(idea) == 2, 20)
            assert not idea.GetPrimAtPath("/World/Gone") and idea.GetPrimAtPath("/World/Globe")
        assert run("cat", f"{server.url}/root.usda?session=dusk") == cat(server, "root.usda")
        assert "Later" in run("cat", f"{server.url}/later.usda?session=dusk")
    server.stop()
    server.start()
    assert run("cat", f"{server.url}/root.usda?session=dusk") == cat(server, "root.usda")


# --- the calls of programs (usdlive.sessions)


def test_programs_create_merge_and_end_sessions(project, serve):
    server = serve(project)
    sessions = usdlive.sessions(server.url, user="bo")
    assert sessions.list() == []
    with connect(server, "ada") as ada:
        layer = ada.open_layer("root.usda")
        layer.GetAttributeAtPath("/World.number").default = 1
        first = ada.create_checkpoint("lunch").revision
        layer.GetAttributeAtPath("/World.number").default = 3
        assert ada.flush(20)
        assert sessions.create("dawn", checkpoint="lunch").revision == first
        sessions.end("dawn")
        sessions.delete("dawn")
        made = sessions.create("dusk", revision=first)
        assert (made.name, made.creator, made.revision, made.ended, made.merged) == ("dusk", "bo", first, False, 0)
        assert sessions.list() == [made]
        with usdlive.connect(made.address, user="bo") as bo:
            idea = bo.open_layer("root.usda")
            assert number(idea) == 1
            idea.GetAttributeAtPath("/World.number").default = 2
            idea.GetAttributeAtPath("/World/Ball.radius").default = 7
            assert bo.flush(20)
        dry = sessions.merge("dusk", dry_run=True)
        assert (dry.revision, dry.created, dry.dropped) == (0, (), 0)
        assert [(edit.kind, edit.path, edit.field) for edit in dry.edits] == [("set", "/World/Ball.radius", "default")]
        [conflict] = dry.conflicts
        assert (conflict.what, conflict.layer, conflict.path, conflict.field) == ("value", "root.usda", "/World.number", "default")
        assert [one["value"] if isinstance(one, dict) else one
                for one in (conflict.before, conflict.main, conflict.session)] == [1, 3, 2]
        assert (conflict.main_user, conflict.session_user, conflict.take) == ("ada", "bo", None)
        with pytest.raises(usdlive.Error, match="1 conflict is not decided") as undecided:
            sessions.merge("dusk")
        assert undecided.value.code == "invalidArgument"
        with pytest.raises(ValueError, match="no side of a conflict"):
            sessions.merge("dusk", take="both")
        with pytest.raises(ZeroDivisionError):  # the exception of the function is not lost
            sessions.merge("dusk", take=lambda one: 1 / 0)
        assert number(layer) == 3 and not sessions.list()[0].ended
        asked = []
        updated = sessions.update("dusk", take=lambda one: asked.append(one) or "session")
        assert [one.path for one in asked] == ["/World.number"] and updated.conflicts[0].take == "session"
        merged = sessions.merge("dusk", keep=True)
        assert merged.revision > 0 and merged.conflicts == ()
        assert ada.wait(lambda: (number(layer), radius(layer)) == (2, 7), 20)
        assert sessions.merge("dusk").edits == () and sessions.list()[0].ended
        assert not sessions.restore("dusk").ended
        assert sessions.end("dusk").ended
        assert sessions.delete("dusk").name == "dusk" and sessions.list() == []


def test_programs_get_errors_that_help(project, serve):
    server = serve(project)
    sessions = usdlive.sessions(server.url)
    for call in (sessions.end, sessions.restore, sessions.delete, sessions.merge, sessions.update):
        with pytest.raises(usdlive.Error, match="no live session none") as error:
            call("none")
        assert error.value.code == "invalidArgument"
    with pytest.raises(usdlive.Error, match="there is no revision 99"):
        sessions.create("dusk", revision=99)
    with pytest.raises(usdlive.Error, match='no checkpoint "lunch"') as error:
        sessions.create("dusk", checkpoint="lunch")
    assert error.value.code == "invalidArgument"
    with pytest.raises(ValueError, match="not with both"):
        sessions.create("dusk", revision=1, checkpoint="lunch")
    with pytest.raises(usdlive.Error, match="over HTTP"):
        usdlive.sessions("dds://project").list()
    with pytest.raises(usdlive.Error) as wrong:
        usdlive.sessions("http://x y")
    assert wrong.value.code == "invalidArgument"
    server.stop()
    with pytest.raises(usdlive.Error) as gone:
        sessions.list()
    assert gone.value.code == "notConnected"


def test_programs_merge_on_another_thread_while_an_editor_goes_on(project, serve):
    server = serve(project)
    with connect(server, "ada") as ada:
        layer = ada.open_layer("root.usda")
        sessions, ends = usdlive.sessions(server.url, user="ada"), []

        def work():
            with usdlive.connect(sessions.create("dusk").address, user="ada") as idea:
                idea.open_layer("root.usda").GetAttributeAtPath("/World/Ball.radius").default = 7
                assert idea.flush(20)
            ends.append(sessions.merge("dusk").revision)

        thread = threading.Thread(target=work)
        thread.start()
        assert ada.wait(lambda: radius(layer) == 7, 30), "ticks go on meanwhile"
        thread.join()
        assert ends and ada.revision >= ends[0]


def test_the_program_of_the_document_runs(project, serve):
    (project / "shot.usda").write_text(ROOT)
    server = serve(project)
    [program] = [one.code for one in blocks("docs/live-sessions.md") if "usdlive.sessions(" in one.code]
    ran = subprocess.run([sys.executable, "-c", program.replace("ws://127.0.0.1:7447", server.url)], capture_output=True, text=True)
    assert (ran.stdout, ran.returncode) == ("1 edit\n", 0), ran.stderr
    assert "double radius = 7" in cat(server, "shot.usda") and listed(server)["dusk"]["ended"]


# --- backups


def test_a_backup_has_the_sessions(project, serve, tmp_path):
    server = serve(project)
    for name in ("dusk", "ended", "damaged"):
        run("session", "create", server.url, name, "--user", "bo")
    with join(server, "ended", "bo") as bo:
        bo.open_layer("root.usda").GetAttributeAtPath("/World.number").default = 5
        assert bo.flush(20)
    for name in ("ended", "damaged"):
        run("session", "end", server.url, name)
    (project / ".usdlive" / "sessions" / "damaged" / "store" / "db" / "CURRENT").write_text("damaged")
    with join(server, "dusk", "bo") as bo:
        idea = bo.open_layer("root.usda")
        idea.GetAttributeAtPath("/World.number").default = 2
        idea.GetAttributeAtPath("/World.points").default = Vt.Vec3fArray(BIG, Gf.Vec3f(1, 2, 3))
        assert bo.flush(20)
        run(*MERGE, server.url, "dusk", "--keep")
        idea.GetAttributeAtPath("/World/Ball.radius").default = 7
        assert bo.flush(20)
        done = subprocess.run([os.environ["USDLIVE_BIN"], "backup", project, tmp_path / "copy"], capture_output=True, text=True)
        assert done.returncode == 0 and ", 2 live sessions, with" in done.stdout, done.stderr
        assert "the live session damaged is not in the backup" in done.stderr
        idea.GetAttributeAtPath("/World/Ball.radius").default = 8  # later than the backup
        assert bo.flush(20)
    server.stop()
    copy = serve(tmp_path / "copy")
    assert {name: one["ended"] for name, one in listed(copy).items()} == {"dusk": False, "ended": True}
    with join(copy, "dusk", "cy") as cy:
        idea = cy.open_layer("root.usda")
        assert (number(idea), radius(idea)) == (2, 7)
        assert len(idea.GetAttributeAtPath("/World.points").default) == BIG
    merged = json.loads(run(*MERGE, copy.url, "dusk", "--json"))
    assert [edit["path"] for edit in merged["edits"]] == ["/World/Ball.radius"], "the backup knows what was merged before"
    run("session", "restore", copy.url, "ended")
    assert "int number = 5" in run("cat", f"{copy.url}/root.usda?session=ended")
    copy.stop()
    # Without a server, the command opens the stores itself.
    assert ", 2 live sessions, with" in run("backup", str(tmp_path / "copy"), str(tmp_path / "again"))


# --- any order of edits, merges and updates


class Editor:
    """An editor of one line that edits two layers at random: names of its own, and the few that both lines have."""

    LAYERS = ("root.usda", "late.usda")

    def __init__(self, url: str, user: str, random):
        self.live = usdlive.connect(url, user=user, application="test")
        self._random, self._user, self._count = random, user, 0

    def edit(self) -> None:
        layer = self.live.open_layer(self._random.choice(self.LAYERS))
        prims = [prim.path for prim in layer.GetPrimAtPath("/World").nameChildren]
        self._count += 1
        kind, path = self._random.randrange(6), self._random.choice(prims) if prims else None
        if kind < 2 or path is None:
            prim = Sdf.CreatePrimInLayer(layer, f"/World/{self._user}{self._count}")
            prim.specifier = Sdf.SpecifierDef
            Sdf.AttributeSpec(prim, "radius", Sdf.ValueTypeNames.Double).default = self._count
        elif kind == 2:
            moved(layer, str(path), f"/World/{self._user}{self._count}")
        elif kind == 3 and self._random.random() < 0.4:
            moved(layer, str(path), "")
        else:
            prim = layer.GetPrimAtPath(path)
            attribute = prim.attributes.get("radius") or Sdf.AttributeSpec(prim, "radius", Sdf.ValueTypeNames.Double)
            attribute.default = self._count
        assert self.live.flush(20)


@pytest.mark.parametrize("seed", range(int(os.environ.get("USDLIVE_LINE_SEEDS", "3"))))
def test_lv7_after_any_edits_merges_and_updates_the_lines_get_alike(seed, project, serve):
    (project / "late.usda").write_text('#usda 1.0\n\ndef "World"\n{\n    def "One"\n    {\n    }\n}\n')
    server, random = serve(project), Random(seed)
    sessions = usdlive.sessions(server.url, user="cy")
    first = Editor(server.url, "ada", random)
    with first.live:
        for _ in range(random.randrange(4)):
            first.edit()
        sessions.create("dusk", revision=random.randrange(first.live.revision + 1))
        second = Editor(at(server, "dusk"), "bo", random)
        with second.live:
            for _ in range(30):
                side = random.choice(("main", "session"))
                match random.randrange(10):
                    case 0:
                        sessions.update("dusk", take=side)
                    case 1:
                        sessions.merge("dusk", take=side, keep=True)
                    case 2:
                        first.live.save()
                    case _:
                        random.choice((first, second)).edit()
            sessions.update("dusk", take="session")
            assert sessions.merge("dusk", keep=True).conflicts == ()
            for layer in Editor.LAYERS:
                assert cat(server, layer) == run("cat", f"{server.url}/{layer}?session=dusk"), layer
            assert sessions.merge("dusk", keep=True).edits == sessions.update("dusk").edits == ()
