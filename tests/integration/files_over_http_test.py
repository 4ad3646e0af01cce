"""Tests reading a project over HTTP, without the client library (AS1-AS5)."""

from __future__ import annotations

import ctypes
import hashlib
import http.client
import json
import os
import threading
import time
import urllib.parse

import pytest
from conftest import connect, wait
from pxr import Sdf

TEXT = '#usda 1.0\n(\n    subLayers = [@./lib.usda@]\n)\n\ndef Sphere "Ball"\n{\n    double radius = 1\n}\n\n'


def get(server, path, method="GET", **headers):
    """Returns (status, headers, body)."""
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=20)
    try:
        connection.request(method, path, headers={name.replace("_", "-"): text
                                                  for name, text in headers.items()})
        answer = connection.getresponse()
        return answer.status, dict(answer.getheaders()), answer.read()
    finally:
        connection.close()


def listed(server, query="", prefix=""):
    status, _, body = get(server, f"{prefix}/files{query}")
    assert status == 200, body
    listing = json.loads(body)
    return listing, {one["path"]: one for one in listing["files"]}


def inflated(frame: bytes) -> bytes:
    zstd = ctypes.CDLL("libzstd.so.1")
    zstd.ZSTD_getFrameContentSize.restype = ctypes.c_ulonglong
    zstd.ZSTD_decompress.restype = zstd.ZSTD_findFrameCompressedSize.restype = ctypes.c_size_t
    size = zstd.ZSTD_getFrameContentSize(frame, ctypes.c_size_t(len(frame)))
    content = ctypes.create_string_buffer(size)
    assert zstd.ZSTD_decompress(content, ctypes.c_size_t(size), frame, ctypes.c_size_t(len(frame))) == size
    assert zstd.ZSTD_findFrameCompressedSize(frame, ctypes.c_size_t(len(frame))) == len(frame), "one frame"
    return content.raw


def sha(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


@pytest.fixture
def project(tmp_path):
    folder = tmp_path / "shots"
    (folder / "tex").mkdir(parents=True)
    (folder / "shot.usda").write_text(TEXT)
    (folder / "lib.usda").write_text('#usda 1.0\ndef "Lib"\n{\n}\n')
    (folder / "tex" / "my brick.png").write_bytes(os.urandom(3_000_000))
    (folder / ".secret").write_text("secret")
    (tmp_path / "outside.png").write_text("secret")
    (folder / "out.png").symlink_to("../outside.png")
    (folder / "same.png").symlink_to("tex/my brick.png")
    return folder


def set_radius(live, value):
    layer = live.open_layer("shot.usda")
    layer.GetAttributeAtPath("/Ball.radius").default = value
    assert live.flush(20)
    return live.revision



def test_a_file_may_have_the_name_of_an_address(project, serve):
    for name in ("live", "users", "sessions", "files", "healthz", "files.d/live"):
        (project / name).parent.mkdir(exist_ok=True)
        (project / name).write_text(f"the file {name}")
    server = serve(project)
    for prefix in ("", "/shots"):
        for name in ("live", "users", "sessions", "files", "healthz", "files.d/live"):
            assert get(server, f"{prefix}/files/{name}")[::2] == (200, f"the file {name}".encode())
    with connect(server, "ada") as ada:
        assert ada.open_layer("shot.usda")


def test_every_file_of_the_project_is_listed_and_served(serve, project):
    server = serve(project)
    listing, files = listed(server)
    assert listing["project"] == "shots" and listing["revision"] == 0
    assert list(files) == ["lib.usda", "same.png", "shot.usda", "tex/my brick.png"]
    for path, entry in files.items():
        content = (project / path).read_bytes()
        assert (entry["hash"], entry["size"]) == (sha(content), len(content))
        for prefix in ("", "/shots"):
            address = f"{prefix}/files/{urllib.parse.quote(path)}"
            status, headers, body = get(server, f"{address}?hash={entry['hash']}")
            assert (status, body) == (200, content)
            assert headers["ETag"] == f'"{entry["hash"]}"' and headers["Usdlive-Sha256"] == sha(content)
    status, headers, body = get(server, "/files/tex/my%20brick.png", Range="bytes=1000000-1999999")
    assert status == 206 and body == (project / "tex/my brick.png").read_bytes()[1000000:2000000]
    status, headers, body = get(server, "/files/same.png", method="HEAD")
    assert (status, headers["Content-Length"], body) == (200, "3000000", b"")


def test_nothing_outside_the_project_is_served(serve, project):
    server = serve(project)
    for path, expected in {"/files/out.png": 403, "/files/.secret": 400, "/files/../outside.png": 400,
                           "/files/%2e%2e/outside.png": 400, "/files/tex/..%2f..%2foutside.png": 400,
                           "/files/.usdlive/store/head": 400, "/files//etc/passwd": 400,
                           "/files/tex": 404, "/files/nothing.png": 404, "/nobody/files": 404}.items():
        status, _, body = get(server, path)
        assert status == expected, (path, status, body)
        assert body != b"secret" and body.count(b"\n") == 1
    assert get(server, "/files?revision=7")[0] == 404
    assert get(server, "/files?checkpoint=none")[0] == 404
    assert get(server, "/files?revision=x")[0] == 400


def test_the_list_follows_the_folder(serve, project):
    server = serve(project)
    _, headers, _ = get(server, "/files")
    assert get(server, "/files", If_None_Match=headers["ETag"])[0] == 304
    (project / "new.exr").write_bytes(b"new")
    status, _, body = get(server, "/files", If_None_Match=headers["ETag"])
    assert status == 200 and b"new.exr" in body
    _, files = listed(server)
    old = files["new.exr"]["hash"]
    (project / "new.exr").write_bytes(b"other")
    status, _, body = get(server, f"/files/new.exr?hash={old}")
    assert status == 409 and sha(b"other").encode() in body
    assert listed(server)[1]["new.exr"]["hash"] == sha(b"other")
    (project / "new.exr").unlink()
    assert get(server, f"/files/new.exr?hash={old}")[0] == 404
    assert "new.exr" not in listed(server)[1]


def test_the_list_without_layers_changes_only_with_other_files(serve, project):
    (project / "lib.usda").rename(project / "LIB.USDA")
    server = serve(project)

    def tag(query="?layers=no"):
        return get(server, f"/files{query}")[1]["ETag"]

    listing, files = listed(server, "?layers=no")
    assert list(listing) == ["files", "project"] and list(files) == ["same.png", "tex/my brick.png"]
    before, all_before = tag(), tag("")
    with connect(server, "ada") as live:
        set_radius(live, 2.0)
        assert tag() == before and tag("") != all_before
        status, headers, body = get(server, "/files?layers=no", If_None_Match=before)
        assert (status, body) == (304, b"")
        (project / "new.png").write_bytes(b"new")
        assert tag() != before and listed(server, "?layers=no")[1]["new.png"]["hash"] == sha(b"new")
        (project / "new.png").unlink()
        assert tag() == before
    assert get(server, "/files?layers=yes")[0] == 400


def test_layers_are_served_as_of_one_revision(serve, project):
    server = serve(project)
    with connect(server, "ada") as live:
        live.open_layer("shot.usda")
        first = set_radius(live, 2.0)
        live.create_checkpoint("two")
        second = set_radius(live, 3.0)

        def radius(query):
            status, headers, body = get(server, f"/files/shot.usda{query}")
            assert status == 200, body
            assert headers["Usdlive-Sha256"] == sha(body)
            layer = Sdf.Layer.CreateAnonymous(".usda")
            assert layer.ImportFromString(body.decode())
            assert layer.subLayerPaths == ["./lib.usda"]
            return layer.GetAttributeAtPath("/Ball.radius").default, headers["ETag"].strip('"')

        at_first, at_second = listed(server, f"?revision={first}"), listed(server)
        assert at_first[0]["revision"] == first and at_second[0]["revision"] == second
        assert radius("") == (3.0, at_second[1]["shot.usda"]["version"])
        assert radius(f"?revision={first}") == (2.0, at_first[1]["shot.usda"]["version"])
        assert radius("?checkpoint=two") == radius(f"?revision={first}")
        assert listed(server, "?checkpoint=two")[0]["revision"] == first
        # The file is another thing than the layer, until somebody saves it.
        assert b"radius = 1" in (project / "shot.usda").read_bytes()
        # An edit of one layer keeps the version of the others.
        other = live.open_layer("lib.usda")
        other.GetPrimAtPath("/Lib").comment = "changed"
        assert live.flush(20)
        after = listed(server)[1]
        assert after["shot.usda"] == at_second[1]["shot.usda"]
        assert after["lib.usda"]["version"] != at_second[1]["lib.usda"]["version"]


def test_binary_layers_are_binary(serve, project):
    layer = Sdf.Layer.CreateNew(str(project / "crate.usdc"))
    Sdf.CreatePrimInLayer(layer, "/Deep/er").comment = "here"
    layer.Save()
    server = serve(project)
    with connect(server, "ada") as live:
        live.open_layer("crate.usdc").GetPrimAtPath("/Deep").comment = "edited"
        assert live.flush(20)
    status, _, body = get(server, "/files/crate.usdc")
    assert status == 200 and body.startswith(b"PXR-USDC")
    copy = project.parent / "copy.usdc"
    copy.write_bytes(body)
    read = Sdf.Layer.FindOrOpen(str(copy))
    assert [read.GetPrimAtPath(path).comment for path in ("/Deep", "/Deep/er")] == ["edited", "here"]


def test_a_file_that_is_written_all_the_time_is_never_mixed(serve, project):
    """A reader gets one content, whose hash is right, or an error; never parts of two."""
    server = serve(project)
    file, size = project / "busy.bin", 4_000_000
    stop = threading.Event()

    def write():
        step = 0
        while not stop.is_set():
            step += 1
            with file.open("r+b" if file.exists() else "wb") as out:
                for _ in range(8):
                    out.write(bytes([step % 256]) * (size // 8))
                    out.flush()
            time.sleep(0.01)

    writer = threading.Thread(target=write)
    writer.start()
    try:
        end = time.monotonic() + 4
        while time.monotonic() < end:
            try:
                status, headers, body = get(server, "/files/busy.bin")
            except (http.client.IncompleteRead, ConnectionError):
                continue
            if status == 200 and headers["Usdlive-Sha256"] == sha(body):
                assert len(set(body)) <= 2
    finally:
        stop.set()
        writer.join()
    status, headers, body = get(server, "/files/busy.bin")
    assert status == 200 and headers["Usdlive-Sha256"] == sha(body) == sha(file.read_bytes())


def test_several_projects_have_their_own_files(serve, tmp_path):
    for name in ("alpha", "my beta"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "a.txt").write_text(name)
    server = serve(tmp_path / "alpha", str(tmp_path / "my beta"))
    assert get(server, "/alpha/files/a.txt")[2] == b"alpha"
    assert get(server, "/my%20beta/files/a.txt")[2] == b"my beta"
    assert get(server, "/files/a.txt")[0] == 404


def test_as5_what_gets_smaller_is_compressed(serve, project):
    text = "".join(f"v {i} {i * 7 % 13} 0\n" for i in range(100_000)).encode()
    (project / "many.obj").write_bytes(text)
    (project / "small.obj").write_bytes(text[:1000])
    (project / "large.obj").write_bytes(text * 60)  # more than 64 MiB
    for number in range(40):
        (project / f"other{number}.bin").write_bytes(b"x")
    server = serve(project)
    with connect(server, "ada") as live:
        layer = live.open_layer("shot.usda")
        layer.documentation = text[:100_000].decode()
        assert live.flush(20)
    # The hash of a large file is computed in the background, and changes the lists.
    wait(lambda: "hash" in listed(server)[1]["large.obj"], timeout=30)
    for path in ("/files?layers=no", "/files", "/files/many.obj", "/files/shot.usda"):
        _, plain, content = get(server, path)
        status, headers, frame = get(server, path, Accept_Encoding="zstd")
        assert status == 200 and headers["Content-Encoding"] == "zstd" and "Content-Encoding" not in plain, path
        assert inflated(frame) == content and len(frame) < 0.8 * len(content), path
        assert headers["ETag"] == plain["ETag"][:-1] + '-zstd"'
        assert headers.get("Usdlive-Sha256") == plain.get("Usdlive-Sha256")
        for known in (plain["ETag"], headers["ETag"]):
            assert get(server, path, Accept_Encoding="zstd", If_None_Match=known)[0] == 304, path
    for path in ("/files/small.obj", "/files/large.obj", "/files/tex/my%20brick.png"):
        _, headers, content = get(server, path, Accept_Encoding="zstd")
        assert "Content-Encoding" not in headers and sha(content) == headers["Usdlive-Sha256"], path


def test_as5_layers_of_one_commit_are_compressed_each(serve, project):
    server = serve(project)
    with connect(server, "ada") as live:
        layers = [live.open_layer(name) for name in ("shot.usda", "lib.usda")]
        for number, layer in enumerate(layers):
            layer.documentation = f"text {number} " * 500
        assert live.flush(20)
    plain = [get(server, f"/files/{name}") for name in ("shot.usda", "lib.usda")]
    packed = [get(server, f"/files/{name}", Accept_Encoding="zstd") for name in ("shot.usda", "lib.usda")]
    assert plain[0][1]["ETag"] == plain[1][1]["ETag"], "both have the version of the commit"
    assert [inflated(body) for _, _, body in packed] == [body for _, _, body in plain]
