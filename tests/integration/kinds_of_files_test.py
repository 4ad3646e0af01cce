"""Every access to a file ends with a clear error or the right result whatever stands in its place: nothing blocks, and nothing
that is not a regular file is replaced."""

import json
import os
import shutil
import socket
import stat
import subprocess
import time
import urllib.error
import urllib.request

import pytest
import wire

ROOT = '#usda 1.0\n\ndef "World"\n{\n}\n'


def bind(path):
    with socket.socket(socket.AF_UNIX) as made:
        folder = os.open(path.parent, os.O_RDONLY)
        made.bind(f"/proc/self/fd/{folder}/{path.name}")  # the path of a socket is short
        os.close(folder)


def device(number):
    def make(path):
        try:
            os.mknod(path, stat.S_IFCHR | 0o666, os.makedev(1, number))
        except PermissionError:
            os.mkfifo(path)  # without root
    return make


def unreadable(path):
    path.write_text(ROOT)
    path.chmod(0)


KINDS = {
    "folder": lambda path: path.mkdir(),
    "dangling link": lambda path: path.symlink_to("nowhere.usda"),
    "loop of links": lambda path: path.symlink_to(path.name),
    "link outside": lambda path: path.symlink_to("/etc/hostname"),
    "endless device": device(5),
    "empty device": device(3),
    "pipe": os.mkfifo,
    "socket": bind,
    "unreadable file": unreadable,
}
NAMES = {kind: kind.replace(" ", "-") for kind in KINDS}


def what(path):
    found = path.lstat()
    return found.st_mode, found.st_ino, os.readlink(path) if path.is_symlink() else ""


def status(server, path):
    try:
        with urllib.request.urlopen(f"http://127.0.0.1:{server.port}{path}", timeout=10) as answer:
            return answer.status
    except urllib.error.HTTPError as error:
        return error.code


def tool(*arguments):
    return subprocess.run([os.environ["USDLIVE_BIN"], *map(str, arguments)], capture_output=True, text=True, timeout=20)


@pytest.fixture
def served(project, serve):
    (project / "root.usda").write_text(ROOT)
    for name in NAMES.values():
        (project / f"{name}.usda").write_text(ROOT)
    return serve(project)


def test_whatever_takes_the_place_of_a_layers_file(served, project):
    with wire.Peer(served.url) as peer:
        for number, name in enumerate(NAMES.values(), 1):
            peer.send(wire.control("openLayer", request=number, layer=f"{name}.usda", revision=0))
        for _ in NAMES:
            assert peer.expect("layerOpened")
        placed = {}
        for kind, make in KINDS.items():
            path = project / f"{NAMES[kind]}.usda"
            path.unlink()
            make(path)
            placed[kind] = what(path)
        request = 100
        for kind, name in NAMES.items():
            for verb, answer, more in (("reloadLayers", "layersReloaded", {}), ("saveLayers", "layersSaved", {}),
                                       ("saveLayers", "layersSaved", {"force": True})):
                request += 1
                peer.send(wire.control(verb, request=request, layers=[f"{name}.usda"], **more))
                ended = peer.expect(answer, timeout=20)
                if kind != "unreadable file" or os.getuid() != 0 and verb == "reloadLayers":
                    assert ended["failed"] and ended["failed"][0]["message"], (kind, verb, ended)
        for kind in KINDS:
            if kind != "unreadable file":
                assert what(project / f"{NAMES[kind]}.usda") == placed[kind], f"{kind} was replaced"
        peer.send(wire.control("openLayer", request=1_000, layer="root.usda", revision=0))
        assert peer.expect("layerOpened")


def test_whatever_stands_in_place_of_a_texture(served, project, tmp_path):
    source = tmp_path / "source.png"
    source.write_bytes(b"texture")
    for kind, make in KINDS.items():
        path = project / f"{NAMES[kind]}.png"
        make(path)
        placed = what(path)
        assert status(served, f"/files/{path.name}") in (200, 403, 404, 500), kind
        uploaded = tool("upload", served.url, source, path.name, "--overwrite")
        if kind != "unreadable file":
            assert uploaded.returncode == 1 and path.name in uploaded.stderr, (kind, uploaded)
            assert what(path) == placed, f"{kind} was replaced"
        if kind not in ("link outside", "unreadable file"):
            taken = tool("upload", served.url, path, f"from-{path.name}")
            assert taken.returncode == 1 and not (project / f"from-{path.name}").exists(), (kind, taken)
    assert status(served, "/files") == 200


@pytest.mark.parametrize("name", ["server.json", "store/head", "store/lock", "store", "blobs"])
def test_whatever_stands_in_the_store(project, serve, name):
    """The server starts, or ends with an error that names the file."""
    (project / "root.usda").write_text(ROOT)
    server = serve(project)
    server.stop()
    path = project / ".usdlive" / name
    kept = project.parent / "kept"
    if path.exists():
        path.rename(kept)
    for kind in ("pipe", "socket", "endless device", "loop of links"):
        KINDS[kind](path)
        server.launch()
        end = time.monotonic() + 20
        while server.process.poll() is None and not server.port_file.exists():
            assert time.monotonic() < end, f"{kind} as {name}: neither serves nor ends"
            time.sleep(0.01)
        if server.process.poll() is None:
            assert server.stop() == 0
        else:
            assert server.process.returncode == 1, kind
        if os.path.lexists(path):
            shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink()
    if kept.exists():
        kept.rename(path)
    server.start()
    assert json.loads(tool("stat", server.url, "--json").stdout)["revision"] == 0
