"""Tests several projects in one server process."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import urllib.request

import pytest
import usdlive
from conftest import connect, refused, run, wait

LAYER = '#usda 1.0\ndef Sphere "Ball"\n{\n    double radius = 1\n}\n'


def make(folder, layer="shot.usda"):
    folder.mkdir(parents=True)
    (folder / layer).write_text(LAYER)
    return folder


def join(server, name, user="ada"):
    return usdlive.connect(f"{server.url}/{name}", user=user, application="test")


def get(server, path):
    with urllib.request.urlopen(server.url.replace("ws", "http", 1) + path, timeout=20) as page:
        return page.read().decode()


def projects(server):
    return {one["name"]: one for one in json.loads(get(server, "/projects"))["projects"]}


def set_radius(live, value):
    layer = live.open_layer("shot.usda")
    layer.GetAttributeAtPath("/Ball.radius").default = value
    assert live.flush(20)


def radius(live):
    return live.open_layer("shot.usda").GetAttributeAtPath("/Ball.radius").default


def damage(folder):
    """Makes a store that cannot be opened; returns a function that repairs it."""
    manifest, = (folder / ".usdlive" / "store").rglob("MANIFEST-*")
    whole = manifest.read_bytes()
    manifest.write_bytes(b"\xff" * len(whole))
    return lambda: manifest.write_bytes(whole)


def test_each_project_has_an_address(serve, tmp_path):
    server = serve(make(tmp_path / "alpha"), str(make(tmp_path / "my beta")))
    with join(server, "alpha") as alpha, join(server, "my%20beta") as beta:
        set_radius(alpha, 2.0)
        set_radius(beta, 3.0)
        set_radius(beta, 4.0)
        assert (radius(alpha), radius(beta)) == (2.0, 4.0)
        assert {name: one["sessions"] for name, one in projects(server).items()} == {"alpha": 1, "my beta": 1}
    assert "radius = 2" in run("cat", f"{server.url}/alpha/shot.usda")
    assert "radius = 4" in run("cat", f"{server.url}/my%20beta/shot.usda")


def test_an_address_that_names_no_project_says_which_there_are(serve, tmp_path):
    server = serve(make(tmp_path / "alpha"), str(make(tmp_path / "beta")))
    for url in (server.url, f"{server.url}/gamma"):
        with pytest.raises(usdlive.Error, match="the server has alpha, beta"):
            usdlive.connect(url, user="ada")
        assert "the server has alpha, beta" in refused("who", url)
    listed = run("ls", server.url).splitlines()
    assert [line.split()[0] for line in listed] == [f"{server.url}/alpha", f"{server.url}/beta"]
    assert [one["project"] for one in json.loads(run("ls", server.url, "--json"))] == ["alpha", "beta"]


def test_a_browser_gets_a_page_that_says_how_to_connect(serve, tmp_path):
    server = serve(make(tmp_path / "alpha"), str(make(tmp_path / "my beta")))
    page = get(server, "/")
    for url in (f"{server.url}/alpha", f"{server.url}/my%20beta"):
        assert f"  {url}  ok, revision 0, sessions 0\n" in page
    assert f"usdlive ls {server.url}/alpha" in page and f'connect("{server.url}/alpha"' in page
    assert str(tmp_path) not in page, "where a folder is, is nobody's business"
    only = serve(make(tmp_path / "gamma"))
    assert f"  {only.url}  ok" in get(only, "/") and f"usdlive://127.0.0.1:{only.port}/LAYER.usda" in get(only, "/")


def test_the_only_project_has_both_addresses(serve, tmp_path):
    server = serve(make(tmp_path / "alpha"))
    with connect(server, "ada") as ada, join(server, "alpha", "bob") as bob:
        set_radius(ada, 5.0)
        wait(lambda: radius(bob) == 5.0, bob)
    assert run("ls", server.url).split() == ["shot.usda"]
    assert json.loads(get(server, "/healthz"))["status"] == "ok"


def test_two_projects_of_one_name_are_refused(tmp_path):
    folders = [make(tmp_path / parent / "shot") for parent in ("a", "b")]
    ran = subprocess.run([os.environ["USDLIVE_BIN"], "serve", *map(str, folders), "--port", "0"],
                         capture_output=True, text=True, timeout=20)
    assert ran.returncode == 1
    assert ran.stderr.startswith("usdlive-server: two projects would have the name shot: ")
    assert ran.stderr.count("\n") == 1


def test_a_project_that_cannot_be_opened_harms_no_other(serve, tmp_path):
    well, broken = make(tmp_path / "well"), make(tmp_path / "broken")
    server = serve(well, str(broken))
    with join(server, "broken") as ada:
        set_radius(ada, 2.0)
    assert server.stop() == 0
    mend = damage(broken)

    server = serve(well, str(broken))
    with join(server, "well") as ada:
        set_radius(ada, 3.0)
        assert projects(server)["broken"]["status"] == "failed"
        assert "is damaged" in projects(server)["broken"]["reason"]
        assert json.loads(get(server, "/healthz")) == {
            "status": "degraded", "projects": {"well": "ok", "broken": "failed"}}
        assert "is damaged" in run("ls", server.url)
        assert 'the project "broken" cannot be opened' in refused("who", f"{server.url}/broken")
        mend()
        wait(lambda: projects(server)["broken"]["status"] == "ok", ada, timeout=30)
        with join(server, "broken") as bob:
            assert radius(bob) == 2.0
        set_radius(ada, 4.0)


def test_a_store_that_breaks_while_it_is_used_harms_no_other(serve, tmp_path):
    well, broken = make(tmp_path / "well"), make(tmp_path / "broken")
    server = serve(well, str(broken))
    with join(server, "well") as ada, join(server, "broken", "bob") as bob:
        set_radius(bob, 2.0)
        shutil.move(broken / ".usdlive", tmp_path / "taken")
        bob.open_layer("shot.usda").GetAttributeAtPath("/Ball.radius").default = 9.0
        assert not bob.flush(3)
        for value in (5.0, 6.0, 7.0):
            set_radius(ada, value)
        assert projects(server)["well"]["status"] == "ok"
        shutil.move(tmp_path / "taken", broken / ".usdlive")
        assert bob.flush(20)
        set_radius(bob, 9.5)
        assert radius(bob) == 9.5


def test_folders_are_added_and_removed(serve, tmp_path):
    shots = tmp_path / "shots"
    make(shots / "s010")
    (shots / ".hidden").mkdir()
    (shots / "notes.txt").write_text("no folder")
    server = serve(make(tmp_path / "assets"), "--projects", str(shots))
    assert sorted(projects(server)) == ["assets", "s010"]
    make(shots / "s020")
    wait(lambda: projects(server).get("s020", {}).get("status") == "ok")
    with join(server, "s020") as ada, join(server, "s010", "bob") as bob:
        set_radius(ada, 2.0)
        shutil.move(shots / "s020", tmp_path / "away")
        wait(lambda: "s020" not in projects(server), ada, bob, timeout=30)
        set_radius(bob, 3.0)
        # The editor keeps its edits, and continues when the project is back.
        ada.open_layer("shot.usda").GetAttributeAtPath("/Ball.radius").default = 4.0
        ada.tick()
        shutil.move(tmp_path / "away", shots / "s020")
        assert ada.flush(60)
    assert "radius = 4" in run("cat", f"{server.url}/s020/shot.usda")
    assert "radius = 3" in run("cat", f"{server.url}/s010/shot.usda")


def test_metrics_name_the_project(serve, tmp_path):
    server = serve(make(tmp_path / "alpha"), str(make(tmp_path / "beta")))
    with join(server, "beta") as ada:
        set_radius(ada, 2.0)
        page = get(server, "/metrics").splitlines()
    assert 'usdlive_sessions{project="alpha"} 0' in page
    assert 'usdlive_sessions{project="beta"} 1' in page
    assert page.count("# TYPE usdlive_sessions gauge") == 1


def test_a_stop_keeps_acknowledged_edits_of_every_project(serve, tmp_path):
    folders = [make(tmp_path / f"p{index}") for index in range(3)]
    server = serve(folders[0], *map(str, folders[1:]))
    for index in range(3):
        with join(server, f"p{index}") as ada:
            set_radius(ada, 10.0 + index)
    assert server.stop() == 0
    assert "error" not in server.log.read_text()
    server = serve(folders[0], *map(str, folders[1:]))
    for index in range(3):
        assert f"radius = {10 + index}" in run("cat", f"{server.url}/p{index}/shot.usda")


def test_two_projects_over_dds(dds_domain, serve, tmp_path):
    server = serve(make(tmp_path / "alpha"), str(make(tmp_path / "beta")), "--dds", "--dds-domain", str(dds_domain))
    with usdlive.connect("dds://alpha", user="ada") as ada, usdlive.connect("dds://beta", user="bob") as bob:
        set_radius(ada, 2.0)
        set_radius(bob, 3.0)
        assert (radius(ada), radius(bob)) == (2.0, 3.0)
    listed = {one["project"]: one["webSocket"] for one in json.loads(run("ls", "dds://", "--json"))}
    assert listed["beta"] == f"{server.url}/beta"
