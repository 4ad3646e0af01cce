"""`usdlive ls|cat|tree|log|watch|save`."""

import json
import os
import signal
import subprocess
import time

import pytest

ROOT = '#usda 1.0\n\ndef Xform "World"\n{\n    def Sphere "Ball"\n    {\n        double radius = 1\n    }\n}\n\n'


def usdlive(*arguments: str) -> str:
    return subprocess.run([os.environ["USDLIVE_BIN"], *arguments], capture_output=True, text=True,
                          timeout=60, check=True).stdout


@pytest.fixture
def served(project, serve):
    (project / "sets").mkdir()
    (project / "root.usda").write_text(ROOT)
    (project / "sets" / "hall.usda").write_text("#usda 1.0\n")
    return serve(project)


def test_what_is_served_and_what_is_in_it(served):
    assert usdlive("ls", served.url).split() == ["root.usda", "sets/hall.usda"]
    assert usdlive("cat", f"{served.url}/root.usda") == ROOT
    tree = usdlive("tree", f"{served.url}/root.usda")
    assert "World" in tree and "Xform" in tree and "Ball" in tree and "Sphere" in tree


def test_who_changed_what_and_what_it_was_before(served, editor):
    ada = editor(served, "ada", "root.usda")
    ada.run("ball = stage.GetPrimAtPath('/World/Ball')\nball.GetAttribute('radius').Set(2.0)")
    first = ada.flush()
    ada.run("ball.GetAttribute('radius').Set(3.0)")
    ada.flush()
    log = usdlive("log", served.url)
    assert "ada" in log and "/World/Ball.radius" in log
    assert "radius = 2" in usdlive("cat", f"{served.url}/root.usda", "--revision", str(first))
    assert "radius = 3" in usdlive("cat", f"{served.url}/root.usda")


def test_watching_edits_as_they_come(served, editor):
    watch = subprocess.Popen([os.environ["USDLIVE_BIN"], "watch", served.url, "--json"],
                             stdout=subprocess.PIPE, text=True)
    try:
        time.sleep(1)
        ada = editor(served, "ada", "root.usda")
        ada.run("stage.DefinePrim('/World/New')")
        ada.flush()
        line = ""
        while "/World/New" not in line:
            line = watch.stdout.readline()
            assert line
        assert json.loads(line)["user"] == "ada"
    finally:
        watch.send_signal(signal.SIGINT)
        assert watch.wait(timeout=10) == 0


def test_saving_writes_the_files(served, editor):
    ada = editor(served, "ada", "root.usda")
    ada.run("stage.GetPrimAtPath('/World/Ball').GetAttribute('radius').Set(4.0)")
    ada.flush()
    assert "radius = 1" in (served.folder / "root.usda").read_text()
    assert "root.usda" in usdlive("save", served.url)
    assert (served.folder / "root.usda").read_text() == ada.text("root.usda")


def test_help_names_every_verb():
    text = usdlive("--help")
    for verb in ("serve", "ls", "cat", "tree", "log", "watch", "save"):
        assert verb in text
