"""Tests that everything that live layers name is found in `live.open_stage` as it is in the project's folder."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import pathlib
import shutil
import signal
import socket
import subprocess
import sys
import textwrap
import threading
import time

import pytest
import usdlive
from conftest import Relay, connect, wait
from pxr import Ar, Sdf, Tf, Usd, UsdUtils
from resolver_probe import content_hash
from resolver_scene import make_project

HERE = pathlib.Path(__file__).parent
CUBE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 3\n"

PROBE = """
import json, sys, usdlive
from pxr import Usd
from resolver_probe import probe_stage
if len(sys.argv) == 2:
    stage = Usd.Stage.Open(sys.argv[1])
else:
    live = usdlive.connect(sys.argv[1], user="ada")
    assert live._client.files_problem() is None
    stage = live.open_stage(sys.argv[2])
json.dump(probe_stage(stage), sys.stdout)
"""


@pytest.fixture
def fresh(tmp_path):
    """Returns a function that runs code in a new process with usdlive and an empty cache, and returns the printed
    JSON and what was said on stderr."""
    def run(code: str, *arguments, timeout=180, **environment):
        ran = subprocess.run(
            [sys.executable, "-c", textwrap.dedent(code), *map(str, arguments)], cwd=tmp_path, text=True,
            env={**os.environ, "PYTHONPATH": os.pathsep.join([os.environ["PYTHONPATH"], str(HERE)]),
                 "USDLIVE_CACHE": str(tmp_path / f"cache{time.monotonic_ns()}"), **environment},
            capture_output=True, timeout=timeout)
        assert ran.returncode == 0, ran.stderr[-4000:]
        return json.loads(ran.stdout.strip().splitlines()[-1]), ran.stderr
    return run


def sha(path: pathlib.Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def resolved(stage, path):
    with Ar.ResolverContextBinder(stage.GetPathResolverContext()):
        return content_hash(stage.GetAttributeAtPath(path).Get().resolvedPath)


def write_package(path: pathlib.Path, picture: bytes) -> None:
    folder = path.parent.parent / f"unpacked{time.monotonic_ns()}"
    folder.mkdir()
    (folder / "wood.png").write_bytes(picture)
    (folder / "chair.usda").write_text('#usda 1.0\n(\n    defaultPrim = "Chair"\n)\ndef "Chair"\n{\n'
                                       f"    asset wood = @./wood.png@\n    int size = {len(picture)}\n}}\n")
    made = folder / "chair.usdz"
    assert UsdUtils.CreateNewUsdzPackage(str(folder / "chair.usda"), str(made))
    os.replace(made, path)


@pytest.fixture
def shot(project):
    (project / "tex").mkdir()
    (project / "sets" / "wall").mkdir(parents=True)
    (project / "tex" / "brick.png").write_bytes(os.urandom(1000))
    for tile in (1001, 1002):
        (project / "tex" / f"skin.{tile}.png").write_bytes(os.urandom(500))
    (project / "cube.obj").write_text(CUBE)
    write_package(project / "chair.usdz", b"\x89PNG" + os.urandom(300))
    (project / "shot.usda").write_text('''#usda 1.0
(
    subLayers = [@./sets/wall/wall.usda@]
)
def "Cube" (references = @./cube.obj@)
{
}
def "Chair" (references = @./chair.usdz@)
{
}
def "Skin"
{
    asset tiles = @./tex/skin.<UDIM>.png@
}
def "Later" (references = @./later.usdz@)
{
}
''')
    (project / "sets" / "wall" / "wall.usda").write_text(
        '#usda 1.0\nover "Wall"\n{\n    asset brick = @../../tex/brick.png@\n'
        '    asset searched = @tex/brick.png@\n    asset none = @../../tex/none.png@\n}\n')
    return project


@pytest.mark.parametrize("transport", ["ws", "dds"])
def test_a_live_stage_resolves_exactly_what_the_folder_resolves(serve, fresh, tmp_path, request, transport):
    options = ["--dds", "--dds-domain", str(request.getfixturevalue("dds_domain"))] if transport == "dds" else []
    root = make_project(tmp_path / "project")
    (root.parent / "cube.obj").write_text(CUBE)
    with root.open("a") as file:
        file.write('def "Cube" (references = @./cube.obj@)\n{\n}\n')
    (tmp_path / "outside.png").write_bytes(b"outside")
    search = {"PXR_AR_DEFAULT_SEARCH_PATH": str(root.parent / "shared"), "USDLIVE_SEARCH_PATH": "shared"}
    disk, _ = fresh(PROBE, root, **search)
    assert len(disk["prims"]) > 5_000 and len(disk["layers"]) > 50
    assert any(one.startswith("/Cube/") and one.endswith(" Mesh") for one in disk["prims"])
    server = serve(root.parent, *options)
    # The server compresses what it sends in one of the two.
    compression = {"USDLIVE_RESOLVER_COMPRESSION": "1" if transport == "ws" else "0"}
    live, _ = fresh(PROBE, server.url if transport == "ws" else "dds://project", "shot.usda", **search, **compression)
    # A file outside the project is found beside the folder, but is not part of the project.
    outside = "/World/Stronger.away DEFAULT"
    assert disk["assets"].pop(outside)[1] != "unresolved"
    assert live["assets"].pop(outside) == ["../outside.png", "unresolved"]
    assert live["tiles"]["/World/Stronger.udim"]["found"].keys() == {"1001", "1002", "1012"}
    # The content of a live layer is in its Sdf.Layer, and its file is empty.
    itself = "/World assetInfo"
    assert live["assets"].pop(itself)["identifier"][1] not in ("unresolved", "unreadable")
    assert disk["assets"].pop(itself)["identifier"][0] == "./shot.usda"
    for part in disk:
        assert live[part] == disk[part], part


def test_files_that_change_in_the_folder_are_seen_after_an_event(serve, shot):
    server = serve(shot)
    with connect(server, "ada") as live:
        stage = live.open_stage("shot.usda")
        happened = []
        live.add_handler(lambda event: happened.extend(
            event.files if isinstance(event, usdlive.events.FilesChanged) else ()))
        assert resolved(stage, "/Wall.brick") == sha(shot / "tex" / "brick.png")
        assert resolved(stage, "/Wall.searched") == sha(shot / "tex" / "brick.png")
        assert resolved(stage, "/Wall.none") == "unresolved" and not stage.GetPrimAtPath("/Later").GetChildren()
        assert stage.GetAttributeAtPath("/Chair.size").Get() == 304
        points = next(p for p in stage.Traverse() if p.GetTypeName() == "Mesh").GetPath().AppendProperty("points")
        assert len(stage.GetAttributeAtPath(points).Get()) == 3

        (shot / "tex" / "brick.png").write_bytes(b"new")
        (shot / "tex" / "none.png").write_bytes(b"there now")
        (shot / "cube.obj").write_text("v 2 2 2\n" + CUBE.replace("f 1 2 3", "f 1 2 3 4"))
        write_package(shot / "chair.usdz", b"\x89PNG" + os.urandom(600))
        write_package(shot / "later.usdz", b"\x89PNG" + os.urandom(10))
        expected = {"tex/brick.png", "tex/none.png", "cube.obj", "chair.usdz", "later.usdz"}
        wait(lambda: expected <= set(happened), live, timeout=30)
        assert set(happened) == expected
        assert resolved(stage, "/Wall.brick") == sha(shot / "tex" / "brick.png")
        assert resolved(stage, "/Wall.none") == sha(shot / "tex" / "none.png")
        assert stage.GetAttributeAtPath("/Chair.size").Get() == 604
        wait(lambda: stage.GetPrimAtPath("/Later").GetAttribute("size").Get() == 14, live)
        assert len(stage.GetAttributeAtPath(points).Get()) == 4
        # A removed file is an event, too.
        (shot / "tex" / "none.png").unlink()
        happened.clear()
        wait(lambda: "tex/none.png" in happened, live, timeout=30)
        assert resolved(stage, "/Wall.none") == "unresolved"


def test_layers_are_live_by_whatever_address_a_layer_names_them(serve, shot):
    (shot / "prop.usda").write_text('#usda 1.0\n(\n    defaultPrim = "Prop"\n)\ndef "Prop"\n{\n    int x = 1\n}\n')
    server = serve(shot)
    with connect(server, "ada") as ada, connect(server, "bo") as bo:
        stage = ada.open_stage("shot.usda")
        other = bo.open_layer("prop.usda")
        root = stage.GetRootLayer()
        assert root.identifier.startswith("usdlive://127.0.0.1:") and root.identifier.endswith("/shot.usda")
        assert ada.layer_name(root) == "shot.usda" and ada.identifier("shot.usda") == root.identifier
        assert root.GetDisplayName() == "shot.usda"
        # The address of this project, and the one that a layer has in the process of somebody else.
        plain = f"usdlive://127.0.0.1:{server.port}/prop.usda"
        for number, address in enumerate(["./prop.usda", plain, other.identifier]):
            prim = stage.DefinePrim(f"/P{number}")
            prim.GetReferences().AddReference(address)
            assert ada.flush(20)
            wait(lambda: prim.GetAttribute("x").Get() == 1 + number, ada, bo)
            assert {ada.layer_name(spec.layer) for spec in prim.GetAttribute("x").GetPropertyStack()} == {"prop.usda"}
            other.GetAttributeAtPath("/Prop.x").default = 2 + number
            assert bo.flush(20)
            wait(lambda: prim.GetAttribute("x").Get() == 2 + number, ada)


def test_live_stages_keep_the_files_they_have_while_the_server_is_away(serve, shot, tmp_path, capfd):
    write_package(shot / "unread.usdz", b"\x89PNG")
    server = serve(shot)
    live = connect(server, "ada")
    stage = live.open_stage("shot.usda")
    cached = resolved(stage, "/Wall.brick")
    assert cached == sha(shot / "tex" / "brick.png")
    server.kill()
    wait(lambda: not live.connected, live)
    start = time.monotonic()
    assert resolved(stage, "/Wall.brick") == cached
    tile = Ar.ResolvedPath(live.identifier("shot.usda").replace("shot.usda", "tex/skin.1001.png"))
    with pytest.raises(Exception, match="skin.1001.png: .*there is no connection to the server"):
        Ar.GetResolver().OpenAsset(tile)
    content = sha(shot / "unread.usdz")
    package = Ar.ResolvedPath(f"usdlive://127.0.0.1:{server.port}/@~{content}/unread.usdz")
    with pytest.raises(Exception, match="unread.usdz: .*there is no connection to the server"):
        Ar.GetResolver().OpenAsset(package)
    prim = stage.DefinePrim("/Offline")
    prim.CreateAttribute("brick", Sdf.ValueTypeNames.Asset).Set("./tex/brick.png")
    assert resolved(stage, "/Offline.brick") == cached
    assert time.monotonic() - start < 2
    server.start()
    wait(lambda: live.connected, live, timeout=30)
    assert live.flush(20)
    assert content_hash(tile) == sha(shot / "tex" / "skin.1001.png")
    assert content_hash(package) == content
    live.close()


def test_close_does_not_wait_for_a_server_that_hangs(serve, shot):
    server = serve(shot)
    live = connect(server, "ada")
    live.open_stage("shot.usda")
    server.process.send_signal(signal.SIGSTOP)
    try:
        end = time.monotonic() + 2.5  # the list of files is requested every second
        while time.monotonic() < end:
            live.tick()
            time.sleep(0.02)
        start = time.monotonic()
        live.close(timeout=0.5)
        assert time.monotonic() - start < 3
    finally:
        server.process.send_signal(signal.SIGCONT)


class OnlyLive(Relay):
    """Passes WebSocket connections on to a server, and accepts other requests without ever answering them."""

    def _serve(self, here):
        first = here.recv(65536)
        if b" /live" not in first.split(b"\r\n")[0]:
            return
        there = socket.create_connection(("127.0.0.1", self.server.port))
        self._ends.append(there)
        there.sendall(first)
        threading.Thread(target=self._pass, args=(there, here), daemon=True).start()
        self._pass(here, there)

    @staticmethod
    def _pass(one, other):
        with contextlib.suppress(OSError):
            while data := one.recv(65536):
                other.sendall(data)


class Counting(OnlyLive):
    """Passes everything on, and counts the bytes of each answer with the list of files."""

    def __init__(self, server):
        self.lists: list[int] = []
        super().__init__(server)

    def _serve(self, here):
        first = here.recv(65536)
        there = socket.create_connection(("127.0.0.1", self.server.port))
        self._ends.append(there)
        there.sendall(first)
        threading.Thread(target=self._pass, args=(here, there), daemon=True).start()
        if not first.startswith((b"GET /files?", b"GET /files ")):
            return self._pass(there, here)
        count = 0
        with contextlib.suppress(OSError):
            while data := there.recv(65536):
                count += len(data)
                here.sendall(data)
        self.lists.append(count)


def test_commits_do_not_send_the_list_of_files_again(serve, shot):
    for number in range(500):
        (shot / "tex" / f"{number}.bin").write_bytes(b"%d" % number)
    counting = Counting(serve(shot))
    live = usdlive.connect(counting.url, user="ada")
    stage = live.open_stage("shot.usda")
    wait(lambda: counting.lists, live, timeout=30)
    attribute = stage.DefinePrim("/Edited").CreateAttribute("x", Sdf.ValueTypeNames.Int)
    received, revision, number = len(counting.lists), live.revision, 0

    def edited():
        nonlocal number
        attribute.Set(number := number + 1)
        return len(counting.lists) >= received + 3

    wait(edited, live, timeout=60)
    assert live.flush(20) and live.revision > revision + 3
    assert max(counting.lists[:received]) > 20_000 and max(counting.lists[received:]) < 1_000, counting.lists
    (shot / "tex" / "new.bin").write_bytes(b"new")
    wait(lambda: counting.lists[-1] > 20_000, live, timeout=30)
    live.close()
    counting.close()


def test_a_stage_opens_without_files_when_http_does_not_answer(serve, fresh, shot):
    """In bounded time, with a warning that names the prim or the asset, and the cause."""
    only = OnlyLive(serve(shot))
    value, said = fresh("""
        import json, sys, time, usdlive
        live = usdlive.connect(sys.argv[1], user="ada")
        start = time.monotonic()
        stage = live.open_stage("shot.usda")
        found = [stage.GetAttributeAtPath("/Wall.brick").Get().resolvedPath for _ in range(20)]
        opened = time.monotonic() - start
        start = time.monotonic()
        slowest = 0
        while time.monotonic() < start + 3:
            tick = time.monotonic()
            live.tick()
            stage.GetAttributeAtPath("/Wall.brick").Get()
            slowest = max(slowest, time.monotonic() - tick)
        there = [bool(stage.GetPrimAtPath(path)) for path in ("/Chair", "/Cube", "/Wall")]
        live.close()
        print(json.dumps([found[-1], opened, slowest, there]))
        """, only.url, USDLIVE_RESOLVER_TIMEOUT_MS="1000")
    only.close()
    assert value[0] == "" and value[3] == [True, True, True], value
    assert value[1] < 5 and value[2] < 0.5, value
    assert "cannot find" in said and "/tex/brick.png" in said and "did not respond in time" in said, said
    assert "</Chair>" in said and "chair.usdz" in said, said


def test_a_process_that_used_openusd_before_is_told_why_files_are_not_found(serve, fresh, shot):
    server = serve(shot)
    late = """
        import json, sys, warnings
        from pxr import Sdf, Usd
        Sdf.Layer.CreateAnonymous()  # OpenUSD looks for resolvers now
        import usdlive
        said = []
        warnings.showwarning = lambda message, *_: said.append(str(message))
        for _ in range(2):
            live = usdlive.connect(sys.argv[1], user="ada")
            stage = live.open_stage("shot.usda")
            assert live.layer_name(stage.GetRootLayer()) == "shot.usda"
            found = stage.GetAttributeAtPath("/Wall.brick").Get().resolvedPath
            live.close()
        print(json.dumps([said, found]))
        """
    value, _ = fresh(late, server.url)
    assert len(value[0]) == 1 and "Import usdlive before the first layer" in value[0][0] and not value[1], value
    plugins = pathlib.Path(usdlive.plugins.folder())
    value, _ = fresh(late, server.url, PXR_PLUGINPATH_NAME=str(plugins))
    assert value[0] == [] and value[1].endswith("tex/brick.png")


def test_layers_may_keep_paths_in_the_cache_folder(serve, shot):
    server = serve(shot)
    with usdlive.connect(server.url, user="ada", addresses=False) as live:
        stage = live.open_stage("shot.usda")
        assert stage.GetRootLayer().realPath == os.path.join(live.cache_folder, "shot.usda")
        assert stage.GetAttributeAtPath("/Wall.brick").Get().resolvedPath == ""


def test_several_projects_of_a_server_have_their_own_files(serve, shot, tmp_path):
    second = tmp_path / "second"
    shutil.copytree(shot, second)
    (second / "tex" / "brick.png").write_bytes(b"of the second")
    server = serve(shot, str(second))
    with usdlive.connect(f"{server.url}/project", user="ada") as one, \
            usdlive.connect(f"{server.url}/second", user="ada") as two:
        for live, folder in ((one, shot), (two, second)):
            stage = live.open_stage("shot.usda")
            assert resolved(stage, "/Wall.brick") == sha(folder / "tex" / "brick.png")
            assert stage.GetAttributeAtPath("/Chair.size").Get() == 304


def test_a_save_of_an_editor_does_not_overwrite_what_somebody_else_wrote(serve, project):
    (project / "shot.usda").write_text('#usda 1.0\ndef "A"\n{\n    int n = 0\n}\n')
    server = serve(project)
    with connect(server, "ada") as ada:
        stage = ada.open_stage("shot.usda")
        stage.GetAttributeAtPath("/A.n").Set(1)
        assert ada.flush(20)
        (project / "shot.usda").write_text('#usda 1.0\ndef "OfSomebodyElse"\n{\n}\n')
        wait(lambda: ada.layer_states()["shot.usda"].outdated, ada, timeout=20)
        failed: list = []
        ada.add_handler(lambda event: failed.extend(getattr(event, "failed", [])))
        assert stage.GetRootLayer().Save()  # the answer comes later
        wait(lambda: failed, ada, timeout=20)
        assert failed[0].code == "layerOutdated"
        assert "OfSomebodyElse" in (project / "shot.usda").read_text()
        assert ada.save("shot.usda", force=True).saved == ("shot.usda",)
        assert "OfSomebodyElse" not in (project / "shot.usda").read_text()
    with pytest.raises(Tf.ErrorException, match="not editable"):  # nobody would get it
        stage.GetAttributeAtPath("/A.n").Set(2)
        stage.GetRootLayer().Save()


def test_attach_says_that_the_connection_has_the_layer_open(serve, project):
    (project / "shot.usda").write_text('#usda 1.0\ndef "A"\n{\n    int n = 5\n}\n')
    server = serve(project)
    with connect(server, "ada") as ada:
        stage = ada.open_stage("shot.usda")
        other = Usd.Stage.Open(str(project / "shot.usda"))
        with pytest.raises(usdlive.Error, match="another identifier.*close_layer"):
            ada.attach(other)
        ada.close_layer("shot.usda")
        assert ada.attach(other) == ["shot.usda"] and ada.attach(other) == []
        assert stage
