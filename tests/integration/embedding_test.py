"""The programs of docs/embedding.md are the examples, whole; the one in Python runs. (outside_test.py builds and runs the one in
C++.)"""

import re
import subprocess
import sys

import usdlive
from conftest import cat, connect, run
from documents import ROOT, blocks
from usdlive.portable import PortableLive

EXAMPLES = ROOT / "client" / "examples"


def test_the_document_has_the_whole_examples():
    programs = [block.code for block in blocks("docs/embedding.md")]
    for example, lines in (("minimal/main.cpp", 30), ("embed.py", 20)):
        text = (EXAMPLES / example).read_text()
        assert text in programs, f"docs/embedding.md does not have {example} as it is"
        assert len(text.splitlines()) <= lines


def test_the_document_names_what_the_portable_backend_lacks():
    table = next(part for part in (ROOT / "docs" / "embedding.md").read_text().split("\n\n") if part.startswith("| | fast | portable |"))
    named = {name for row in table.splitlines() if row.endswith("| yes | no |") for name in re.findall(r"`(\w+)`", row)}
    public = [{name for name in dir(kind) if not name.startswith("_")} for kind in (usdlive.Live, PortableLive)]
    lacked = public[0] - public[1]
    assert lacked and lacked <= named, lacked - named
    assert not public[1] & named


def test_the_example_in_python_runs(project, serve):
    (project / "shot.usda").write_text("#usda 1.0\n")
    server = serve(project)
    with connect(server, "bob") as bob:
        stage = bob.open_stage("shot.usda")
        editor = subprocess.Popen([sys.executable, EXAMPLES / "embed.py", server.url, "shot.usda", "ada"], stderr=subprocess.PIPE,
                                  text=True)
        assert bob.wait(lambda: [(one.user, one.application, one.selection) for one in bob.presences()] == [("ada", "embed", ("/ada",))])
        assert bob.wait(lambda: stage.GetPrimAtPath("/ada"))
        printed = editor.communicate(timeout=60)[1]
    assert editor.returncode == 0 and not printed
    assert "translate = (119, 0, 0)" in cat(server, "shot.usda")
    assert "Move the ball" in run("log", server.url, "--label", "Move the ball", "--by", "ada")
