"""Tests usdlive:// addresses in plain OpenUSD: processes here do not load usdlive's library."""

from __future__ import annotations

import hashlib
import json
import os
import pathlib
import random
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time

import pytest
from conftest import connect
from resolver_scene import make_project

HERE = pathlib.Path(__file__).parent
PLUGIN = pathlib.Path(os.environ["USDLIVE_BUILD"]) / "usd-plugins" / "usdliveResolver"
LAYER = '#usda 1.0\n(\n    defaultPrim = "Ball"\n)\ndef Sphere "Ball"\n{\n    double radius = 1\n}\n'


@pytest.fixture
def cache(tmp_path):
    return tmp_path / "cache"


@pytest.fixture
def plain(cache, tmp_path):
    """Returns a function that starts plain Python with code, which prints JSON; the result has `value()`."""
    processes = []

    def start(code: str, *arguments, **environment):
        inherited = {name: text for name, text in os.environ.items() if not name.startswith(("PYTHONPATH", "USDLIVE"))}
        process = subprocess.Popen(
            [sys.executable, "-c", code, *map(str, arguments)], cwd=tmp_path,
            env={**inherited, "PXR_PLUGINPATH_NAME": str(PLUGIN), "USDLIVE_CACHE": str(cache),
                 "USDLIVE_USER": "ada", "PYTHONPATH": str(HERE), **environment},
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        processes.append(process)

        def value(timeout=120):
            out, errors = process.communicate(timeout=timeout)
            assert process.returncode == 0, errors[-4000:]
            process.errors = errors
            return json.loads(out) if out.strip() else None
        process.value = value
        return process

    yield start
    for process in processes:
        process.kill()
        process.communicate()


def address(server, path=""):
    return f"usdlive://localhost:{server.port}/{path}"


PROBE = "import json, sys, resolver_probe; json.dump(resolver_probe.probe(sys.argv[1]), sys.stdout)"


def test_an_address_resolves_exactly_what_the_folder_resolves(serve, plain, cache, tmp_path):
    root = make_project(tmp_path / "project")
    (tmp_path / "outside.png").write_bytes(b"outside")
    search = {"PXR_AR_DEFAULT_SEARCH_PATH": str(root.parent / "shared"), "USDLIVE_SEARCH_PATH": "shared"}
    disk = plain(PROBE, root, **search).value()
    assert len(disk["prims"]) > 5_000 and len(disk["layers"]) > 50
    server = serve(root.parent)
    opened = plain(PROBE, address(server, "shot.usda"), **search)
    url = opened.value()
    # A file outside the project is found beside the folder, but is not part of the project.
    outside = "/World/Stronger.away DEFAULT"
    assert disk["assets"].pop(outside)[1] != "unresolved"
    assert url["assets"].pop(outside) == ["../outside.png", "unresolved"]
    assert url["tiles"]["/World/Stronger.udim"]["found"].keys() == {"1001", "1002", "1012"}
    assert url == disk
    # Again, on the full cache.
    again = plain(PROBE, address(server, "shot.usda"), **search).value()
    assert again["assets"].pop(outside) and again == url

    # Live edits are a part of it, and so are layers that nobody has opened.
    with connect(server, "bo") as live:
        live.open_layer("look.usda").GetAttributeAtPath("/World/Stronger.look").default = "./shared/s9.png"
        assert live.flush(20)
    edited = plain(PROBE, address(server, "shot.usda"), **search).value()
    look = "/World/Stronger.look DEFAULT"
    assert edited["assets"].pop(outside) and edited["assets"].pop(look)[0] == "./shared/s9.png"
    assert url["assets"].pop(look)[0] == "./shared/s2.png"
    assert edited["assets"] == url["assets"] and edited["prims"] == url["prims"]


@pytest.fixture
def project(tmp_path):
    folder = tmp_path / "shots"
    (folder / "tex").mkdir(parents=True)
    (folder / "shot.usda").write_text(
        '#usda 1.0\n(\n    subLayers = [@./lib.usda@]\n)\nover "Ball"\n{\n    asset tex = @./tex/brick.png@\n}\n')
    (folder / "lib.usda").write_text(LAYER)
    (folder / "tex" / "brick.png").write_bytes(os.urandom(100_000))
    return folder


def set_radius(live, value):
    live.open_layer("lib.usda").GetAttributeAtPath("/Ball.radius").default = value
    assert live.flush(20)
    return live.revision


RADIUS = """
import json, sys
from pxr import Ar, Usd
def radius(address):
    stage = Usd.Stage.Open(address)
    return stage.GetAttributeAtPath("/Ball.radius").Get()
json.dump([radius(address) for address in sys.argv[1:]], sys.stdout)
"""


def test_an_address_may_name_a_revision_or_a_checkpoint(serve, plain, project):
    server = serve(project)
    with connect(server, "bo") as live:
        first = set_radius(live, 2.0)
        live.create_checkpoint("v1.2")
        set_radius(live, 3.0)
        names = ["shot.usda", f"shot.usda@{first}", "shot.usda@v1%2E2", "lib.usda@v1%2E2", "shots/shot.usda"]
        assert plain(RADIUS, *(address(server, name) for name in names)).value() == [3.0, 2.0, 2.0, 2.0, 3.0]
        failed = plain(RADIUS, address(server, "shot.usda@nobody"))
        with pytest.raises(AssertionError, match="the project has no checkpoint .nobody."):
            failed.value()


def test_a_stage_keeps_its_revision_until_it_is_reloaded(serve, plain, project):
    server = serve(project)
    editor = plain("""
import json, sys, time
from pxr import Ar, Usd, Sdf, Tf
address = sys.argv[1]
stage = Usd.Stage.Open(address)
radius = lambda: stage.GetAttributeAtPath("/Ball.radius").Get()
library = lambda: next(l for l in stage.GetUsedLayers() if l.identifier.endswith("lib.usda"))
stamp = lambda: Ar.GetResolver().GetModificationTimestamp(library().identifier, library().resolvedPath).GetTime()
before = (radius(), stamp())
print(json.dumps("opened"), flush=True)
input()
library().Reload()
kept = radius()
same = Usd.Stage.Open(address)  # another stage of the same process is newer
newer = [same.GetAttributeAtPath("/Ball.radius").Get(), radius()]
stage.Reload()  # which refreshes its context
print(json.dumps([before, kept, newer, radius(), stamp(), str(stage.GetPathResolverContext())]), flush=True)
""", address(server, "shot.usda"))
    with connect(server, "bo") as live:
        first = set_radius(live, 2.0)
        # The first line is printed when the stage is open.
        assert json.loads(editor.stdout.readline()) == "opened"
        time.sleep(1.5)  # the process does not use what it knows for a while
        second = set_radius(live, 5.0)
        editor.stdin.write("\n")
        editor.stdin.flush()
        before, kept, newer, after, stamp, context = json.loads(editor.stdout.readline())
    assert kept == before[0] == 2.0 and newer == [5.0, 2.0] and after == 5.0
    assert stamp != before[1]
    assert f"revision {second}" in context and "user ada" in context and "project shots" in context
    assert first < second


def test_files_are_fetched_when_they_are_first_read_and_once(serve, plain, project, cache):
    server = serve(project)
    (project / "big.bin").write_bytes(os.urandom(500_000))
    value = plain("""
import json, sys
from pxr import Ar, Usd
stage = Usd.Stage.Open(sys.argv[1])
resolved = stage.GetAttributeAtPath("/Ball.tex").Get().resolvedPath
import pathlib
def files(): return sum(1 for f in pathlib.Path(sys.argv[2], "files").rglob("*") if f.is_file())
before = files()
with Ar.GetResolver().OpenAsset(Ar.ResolvedPath(resolved)) as asset:
    size = asset.GetSize()
print(json.dumps([before, files(), size]))
""", address(server, "shot.usda"), cache).value()
    assert value == [2, 3, 100_000]  # the two layers, then the texture; never the other file


def test_files_are_read_only_with_a_reason(serve, plain, project):
    server = serve(project)
    value = plain("""
import json, sys
from pxr import Ar, Sdf, Tf
layer = Sdf.Layer.FindOrOpen(sys.argv[1])
layer.comment = "mine"
said = []
def attempt(action):
    try:
        said.append(str(action()))
    except Tf.ErrorException as error:
        said.append(str(error))
attempt(layer.Save)
attempt(lambda: Sdf.Layer.CreateNew(sys.argv[1].replace("shot", "new")))
attempt(lambda: layer.Export(sys.argv[1].replace("shot", "new")))
print(json.dumps([bool(Ar.GetResolver().CanWriteAssetToPath(layer.resolvedPath)), layer.permissionToSave, said]))
""", address(server, "shot.usda")).value()
    assert value[:2] == [False, False]
    assert "Cannot save layer" in value[2][0] and "saving not allowed" in value[2][1]
    assert "usdlive" in value[2][2] and "read-only" in value[2][2], value[2]
    assert not (project / "new.usda").exists()


def test_a_file_that_changes_is_fetched_again(serve, plain, project):
    server = serve(project)
    code = """
import hashlib, json, sys
from pxr import Ar, Usd
stage = Usd.Stage.Open(sys.argv[1])
def read():
    resolved = Ar.ResolvedPath(stage.GetAttributeAtPath("/Ball.tex").Get().resolvedPath)
    with Ar.ResolverContextBinder(stage.GetPathResolverContext()), Ar.GetResolver().OpenAsset(resolved) as asset:
        return hashlib.sha256(bytes(asset.GetBuffer())).hexdigest()
print(json.dumps("open"), flush=True)
input()
print(json.dumps(read()), flush=True)
"""
    editor = plain(code, address(server, "shot.usda"))
    editor.stdout.readline()
    changed = os.urandom(50_000)
    (project / "tex" / "brick.png").write_bytes(changed)
    editor.stdin.write("\n")
    editor.stdin.flush()
    assert json.loads(editor.stdout.readline()) == hashlib.sha256(changed).hexdigest()


def test_errors_name_the_address_and_the_cause(serve, plain, project):
    server = serve(project)
    code = """
import json, sys, time
from pxr import Tf, Usd
said = []
for address in sys.argv[1:]:
    begin = time.monotonic()
    try:
        Usd.Stage.Open(address)
        said.append("opened")
    except Tf.ErrorException as error:
        said.append(str(error))
    assert time.monotonic() - begin < 10, address
print(json.dumps(said))
"""
    addresses = [address(server, "none.usda"), address(server, "../up.usda"), "usdlive://localhost:1/shot.usda",
                 "usdlive://example.com/shot.usda", "usdlive://localhost:x/shot.usda"]
    causes = ["Failed to open layer", "leads out", "Connection refused. Is `usdlive serve`", "not allowed", "its port is not a number"]
    for text, cause, said in zip(addresses, causes, plain(code, *addresses).value(), strict=True):
        assert cause in said and text.split("/")[-1] in said, said


class Silent(threading.Thread):
    """A server that accepts and never answers, or answers nonsense."""

    def __init__(self, answer: bytes):
        super().__init__(daemon=True)
        self.answer, self.socket = answer, socket.create_server(("127.0.0.1", 0))
        self.port, self.kept = self.socket.getsockname()[1], []
        self.start()

    def run(self):
        while True:
            connection, _ = self.socket.accept()
            self.kept.append(connection)
            if self.answer:
                connection.recv(4096)
                connection.sendall(self.answer)
                connection.close()


@pytest.mark.parametrize("answer, cause", [
    (b"", "did not respond in time"),
    (b"HTTP/1.1 200 OK\r\nContent-Length: 5\r\n\r\nhello", "not a usdlive server"),
    (b"HTTP/1.1 200 OK\r\nContent-Length: 500\r\n\r\nhello", "ended before the end"),
    (b"HTTP/1.1 302 Found\r\nLocation: http://example.com/\r\nContent-Length: 0\r\n\r\n", "not a usdlive server"),
    (b'HTTP/1.1 200 OK\r\nContent-Length: 14\r\n\r\n{"projects":1}', "not a usdlive server"),
    (b"nonsense\r\n\r\n", "no answer")])
def test_strange_servers_are_errors_and_harm_nobody(plain, answer, cause):
    server = Silent(answer)
    failed = plain(RADIUS, f"usdlive://localhost:{server.port}/shot.usda", USDLIVE_RESOLVER_TIMEOUT_MS="500")
    with pytest.raises(AssertionError, match=cause):
        failed.value(20)


def test_the_rest_of_a_stage_loads_without_the_server(plain, tmp_path):
    (tmp_path / "local.usda").write_text(LAYER)
    (tmp_path / "root.usda").write_text(
        '#usda 1.0\ndef "A" (references = [@usdlive://localhost:1/a.usda@</A>, @./local.usda@])\n{\n'
        "    asset tex = @usdlive://localhost:1/a.png@\n}\n")
    process = plain("""
import json, sys
from pxr import Usd
stage = Usd.Stage.Open(sys.argv[1])
prim = stage.GetPrimAtPath("/A")
print(json.dumps([prim.GetAttribute("radius").Get(), prim.GetAttribute("tex").Get().resolvedPath,
                  [str(error) for error in stage.GetCompositionErrors()]]))
""", tmp_path / "root.usda")
    radius, resolved, errors = process.value(30)
    assert (radius, resolved) == (1.0, "")
    assert len(errors) == 1 and "Connection refused" in errors[0] and "</A>" in errors[0]


def test_two_processes_fill_one_cache_while_one_is_killed(serve, plain, tmp_path, cache):
    folder = tmp_path / "shots"
    (folder / "tex").mkdir(parents=True)
    source = random.Random(7)
    textures = []
    for number in range(60):
        (folder / "tex" / f"t{number}.png").write_bytes(source.randbytes(200_000 + number))
        textures.append(f"    asset t{number} = @./tex/t{number}.png@")
    (folder / "shot.usda").write_text('#usda 1.0\ndef "Ball"\n{\n' + "\n".join(textures) + "\n}\n")
    server = serve(folder)
    expected = plain(PROBE, folder / "shot.usda").value()["assets"]
    for round_ in range(3):
        shutil.rmtree(cache, ignore_errors=True)
        killed = plain(PROBE, address(server, "shot.usda"))
        other = plain(PROBE, address(server, "shot.usda"))
        while not list(cache.glob("files/*/*")) and killed.poll() is None:
            time.sleep(0.002)
        time.sleep(source.random() * 0.05)
        killed.send_signal(signal.SIGKILL)
        killed.wait()
        assert other.value()["assets"] == expected
        assert plain(PROBE, address(server, "shot.usda")).value()["assets"] == expected


def test_a_cache_that_cannot_be_written_is_a_warning(serve, plain, project, tmp_path):
    server = serve(project)
    (tmp_path / "file").write_text("not a folder")
    opened = plain(PROBE, address(server, "shot.usda"), USDLIVE_CACHE=str(tmp_path / "file" / "cache"))
    assert opened.value()["assets"]["/Ball.tex DEFAULT"][1] not in ("unresolved", "unreadable")
    assert "cannot be written" in opened.errors and str(tmp_path / "file") in opened.errors


def test_a_cache_on_a_read_only_disk_serves_what_it_has_and_warns_once(serve, plain, project, small_disk):
    folder = small_disk("8m")
    server = serve(project)
    textures = {"stone.png": os.urandom(1 << 20), "brick.png": os.urandom(100)}
    for name, content in textures.items():
        (project / name).write_bytes(content)
    url = address(server, "shot.usda")
    first = plain(PROBE, url, USDLIVE_CACHE=str(folder)).value()
    subprocess.run(["mount", "-o", "remount,ro", str(folder)], check=True)
    read = """
import hashlib, json, sys
from pxr import Ar
resolver = Ar.GetResolver()
hashes = []
for address in sys.argv[1:] * 2:
    with resolver.OpenAsset(resolver.Resolve(address)) as asset:
        hashes.append(hashlib.sha256(asset.GetBuffer()).hexdigest())
json.dump(hashes, sys.stdout)
"""
    again = plain(PROBE, url, USDLIVE_CACHE=str(folder))
    assert again.value() == first
    assert "cache" not in again.errors
    for place in (folder, folder / "below"):
        opened = plain(read, *(address(server, name) for name in textures), USDLIVE_CACHE=str(place))
        assert opened.value() == [hashlib.sha256(content).hexdigest() for content in textures.values()] * 2
        assert opened.errors.count(f"the cache {place} cannot be written: Read-only file system") == 1


def test_several_projects_have_addresses_of_their_own(serve, plain, tmp_path):
    for name, radius in (("alpha", 1), ("my beta", 2)):
        (tmp_path / name).mkdir()
        (tmp_path / name / "lib.usda").write_text(LAYER.replace("= 1", f"= {radius}"))
        (tmp_path / name / "shot.usda").write_text("#usda 1.0\n(\n    subLayers = [@./lib.usda@]\n)\n")
    server = serve(tmp_path / "alpha", str(tmp_path / "my beta"))
    assert plain(RADIUS, address(server, "alpha/shot.usda"), address(server, "my%20beta/shot.usda")).value() == [1, 2]
    with pytest.raises(AssertionError, match="the server has no project .gamma."):
        plain(RADIUS, address(server, "gamma/shot.usda")).value()
