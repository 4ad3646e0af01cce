"""The messages that docs/troubleshooting.md quotes are those of the product: the ten likeliest are caused here, and the
text of the others is in the sources."""

import os
import pathlib
import re
import subprocess
import sys

import pytest
from conftest import Server, cat, connect, error_elsewhere, refused, run, unused_port, wait
from other_openusd_test import pretend_pxr, refused_import
from pxr import Tf

import usdlive

ROOT = pathlib.Path(__file__).parents[2]
DOCUMENT = ROOT / "docs" / "troubleshooting.md"
# Capital words and dots stand in a quote for something that differs.
PLACE = r"\b(?:[A-Z]{3,}(?::[A-Z]{3,})?|DIR|N|X|A|B)\b|\.\.\."


def rows(title: str) -> list[tuple[list[str], str]]:
    """The rows of the table in a section: the quotes in the first cell, and the second cell."""
    section = DOCUMENT.read_text().partition(f"\n## {title}\n")[2].partition("\n## ")[0]
    found = re.findall(r"^\| (`.+?) \| (.+) \|$", section, re.MULTILINE)
    return [([one.strip() for _, one in re.findall(r"(`+)(.+?)\1(?!`)", first)], second) for first, second in found]


TEN = [quotes[0] for quotes, _ in rows("The ten likeliest")]


def quoted(beginning: str) -> re.Pattern:
    """The message of the ten that begins so, as an expression."""
    texts = [text for text in TEN if text.startswith(beginning)]
    assert len(texts) == 1, f"docs/troubleshooting.md does not quote {beginning}"
    return re.compile(".+".join(map(re.escape, re.split(PLACE, texts[0]))))


@pytest.fixture
def shot(project):
    (project / "shot.usda").write_text('#usda 1.0\ndef Xform "World"\n{\n}\n')
    return project


def serving_fails(folder: pathlib.Path, *options: str) -> str:
    done = subprocess.run([os.environ["USDLIVE_BIN"], "serve", folder, *options], text=True, capture_output=True, timeout=30)
    assert done.returncode == 1, done.stdout + done.stderr
    return done.stderr


def test_another_openusd(tmp_path):
    assert quoted("usdlive needs usd-core").search(refused_import([pretend_pxr(tmp_path, "26.11")]))


def test_no_server():
    assert quoted("cannot reach").search(refused("ls", f"127.0.0.1:{unused_port()}"))


def test_a_folder_is_served_twice(shot, serve):
    serve(shot)
    assert quoted("DIR is already served").search(serving_fails(shot, "--port", str(unused_port())))


def test_a_port_is_in_use(shot, serve, tmp_path):
    (tmp_path / "other").mkdir()
    port = serve(shot).port
    assert quoted("cannot listen").search(serving_fails(tmp_path / "other", "--port", str(port)))


def test_a_network_without_users(shot):
    assert quoted("whoever reaches").search(serving_fails(shot, "--host", "0.0.0.0", "--port", str(unused_port())))
    run("user", "add", "ann", "--at", "render:7447", str(shot))
    second = next(cell for quotes, cell in rows("The ten likeliest") if quotes[0].startswith("whoever reaches"))
    said = re.search(r"Without encryption the message is `(.+?)`", second).group(1)
    assert said in serving_fails(shot, "--host", "0.0.0.0", "--port", str(unused_port()))


def test_nobody_has_signed_in(shot, serve, tmp_path, monkeypatch):
    run("user", "add", "ann", "--at", "render:7447", str(shot))
    server = serve(shot)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "somebody else"))
    assert quoted("this server asks").search(refused("ls", server.url))


def test_no_such_layer(shot, serve):
    assert quoted("the project has no layer").search(refused("cat", f"{serve(shot).url}/sho.usda"))


def editing_fails(stage) -> str:
    with pytest.raises(Tf.ErrorException) as raised:
        stage.DefinePrim("/New")
    return str(raised.value)


def test_a_layer_refuses_edits(shot, serve):
    server = serve(shot)
    with connect(server, "bob") as bob:
        stage = bob.open_stage("shot.usda")
        run("lock", server.url, "shot.usda", "--user", "ada")
        wait(lambda: not stage.GetRootLayer().permissionToEdit, bob)
        assert quoted("Layer @").search(editing_fails(stage))
        assert "locked by ada" in run("ls", "-l", server.url)
        assert "shot.usda is locked by ada" in refused("unlock", server.url, "shot.usda", "--user", "bob")
        run("unlock", server.url, "shot.usda", "--user", "ada")
    forgotten = connect(server, "eve")
    stage = forgotten.open_stage("shot.usda")
    with pytest.warns(RuntimeWarning, match="was not closed, and nothing refers to it any more"):
        del forgotten
    assert quoted("Layer @").search(editing_fails(stage))


def test_a_call_on_another_thread(shot, serve):
    with connect(serve(shot), "ada") as ada:
        ada.tick()
        assert quoted("FUNCTION() was called").search(str(error_elsewhere(ada.tick)))


def test_a_file_has_changed(shot, serve):
    server = serve(shot)
    with connect(server, "ada") as ada:
        stage = ada.open_stage("shot.usda")
        stage.DefinePrim("/New")
        assert ada.flush()
        (shot / "shot.usda").write_text('#usda 1.0\ndef "Theirs"\n{\n}\n')
        assert quoted("LAYER was changed").search(ada.save().failed[0].message)
    assert quoted("LAYER was changed").search(refused("save", server.url))
    run("reload", f"{server.url}/shot.usda")
    assert "Theirs" in cat(server, "shot.usda")


def test_each_of_the_ten_is_caused():
    """Looks into this file: tests may run in other processes."""
    beginnings = set(re.findall(r'quoted\("([^"]+)"\)', pathlib.Path(__file__).read_text()))
    assert len(TEN) == 10
    assert not [text for text in TEN if not any(text.startswith(one) for one in beginnings)]


def literals() -> str:
    """The texts of the product, with literals that continue on the next line joined."""
    files = [ROOT / "common" / "protocol" / "errors.json"]
    for folder in ("common", "client/src", "client/python", "server", "plugins"):
        files += [file for file in (ROOT / folder).rglob("*") if file.suffix in (".cpp", ".h", ".py")]
    text = "\n".join(file.read_text() for file in files)
    return re.sub(r'"\s*\n\s*f?"', "", text).replace('\\"', '"')


def test_the_other_messages_are_in_the_sources():
    sources = literals()
    quotes = [quote for found, _ in rows("More messages") for quote in found]
    assert len(quotes) > 15
    parts = [part.strip() for quote in quotes for part in re.split(rf'{PLACE}|[,;:"]', quote)]
    missing = [part for part in parts if len(part) > 4 and part not in sources]
    assert not missing
