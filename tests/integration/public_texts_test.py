"""No text that a server sends names a folder of its machine (FR12), whatever fails."""

import os
import subprocess
import urllib.error
import urllib.request

import pytest
import wire

ROOT = '#usda 1.0\n\ndef "World"\n{\n}\n'


def said(server, *verb):
    ran = subprocess.run([os.environ["USDLIVE_BIN"], *verb], capture_output=True, text=True, timeout=60)
    return ran.stdout + ran.stderr


def page(server, path):
    try:
        with urllib.request.urlopen(f"http://127.0.0.1:{server.port}{path}", timeout=20) as answer:
            return answer.read().decode()
    except urllib.error.HTTPError as error:
        return error.read().decode()


def make_bad_files(folder):
    (folder / "root.usda").write_text(ROOT)
    (folder / "broken.usda").write_text("#usda 1.0\n\ndef {")
    (folder / "empty.usdc").write_bytes(b"")
    (folder / "cut.usdc").write_bytes(b"PXR-USDC" + bytes(100))
    (folder / "folder.usda").mkdir()
    (folder / "out.usda").symlink_to("/etc/passwd")
    (folder / "loop.usda").symlink_to("loop.usda")
    (folder / "package.usdz").write_bytes(b"no package")
    (folder / "sub").mkdir()
    (folder / "sub" / "up").symlink_to("..")
    os.mkfifo(folder / "pipe.usda")


def test_no_text_of_a_server_names_its_folder(project, serve):
    make_bad_files(project)
    server = serve(project)
    texts = [said(server, "ls", server.url, "--skipped", *more) for more in ([], ["--json"])]
    names = ["broken.usda", "empty.usdc", "cut.usdc", "folder.usda", "out.usda", "loop.usda", "pipe.usda", "none.usda"]
    for name in names:
        texts += [said(server, verb, f"{server.url}/{name}") for verb in ("cat", "save", "reload")]
        texts += [page(server, f"/files/{name}"), page(server, f"/files/{name}?revision=99")]
    texts += [page(server, path) for path in ("/", "/files", "/healthz", "/metrics", "/nothing/live", "/files/%2e%2e/x",
                                              "/files/sub/up/root.usda")]
    for file in (project, *project.iterdir()):
        if file.is_file() and not file.is_symlink():
            file.chmod(0o444)
    with wire.Peer(server.url) as peer:
        peer.send(wire.control("uploadFile", request=1, path="sub/up/a.png", hash="0" * 64, size=1))
        peer.send(wire.control("createLayer", request=2, layer="root.usda/below.usda"))
        peer.send(wire.control("saveLayers", request=3, layers=["root.usda", "broken.usda"], force=True))
        peer.send(wire.control("requestBlob", hash="1" * 64, offset=0))
        texts += [str(peer.frame(20)) for _ in range(4)]
    server.kill()
    (project / ".usdlive" / "store" / "db" / "CURRENT").write_text("damaged")
    server.launch()
    server.process.wait(20)
    leaks = [text for text in texts if str(project) in text or str(project.parent) in text]
    assert not leaks, leaks[:3]


def test_a_project_that_cannot_be_opened_says_so_without_its_folder(tmp_path, serve):
    for folder in ("good", "all/bad"):
        (tmp_path / folder).mkdir(parents=True)
        (tmp_path / folder / "root.usda").write_text(ROOT)
    (tmp_path / "all" / "bad" / ".usdlive").write_text("in the way")
    server = serve(tmp_path / "good", "--projects", str(tmp_path / "all"))
    text = page(server, "/bad/files") + page(server, "/healthz")
    assert "cannot be opened" in text and str(tmp_path) not in text, text
