"""Tests the verbs that compose stages with the layers of a project: they show what the same verbs show of its folder."""

import json
import os
import pathlib
import re
import subprocess
import sys

import pytest
from conftest import connect, refused, run
from pxr import Sdf

HERE = pathlib.Path(__file__).parent
SEEDS = 12


@pytest.fixture
def shot(project, serve):
    (project / "shot.usda").write_text("""#usda 1.0
(
    subLayers = [@./fx.usda@]
)
def "Chair" (
    references = @./props/chair.usda@
)
{
}
""")
    (project / "fx.usda").write_text("#usda 1.0\n")
    (project / "props").mkdir()
    (project / "props" / "chair.usda").write_text("""#usda 1.0
(
    defaultPrim = "Chair"
)
def Xform "Chair"
{
    def Cube "Seat"
    {
        double size = 1
    }
}
""")
    return serve(project)


def usage_error(*arguments: str) -> str:
    ran = subprocess.run([os.environ["USDLIVE_BIN"], *arguments], capture_output=True, text=True)
    assert ran.returncode == 2
    return ran.stderr


def test_stages_of_a_project_are_those_of_its_folder(tmp_path, project, serve):
    stages = tmp_path / "list"
    subprocess.run([sys.executable, HERE / "stage_dump.py", stages, "0", str(SEEDS), project], check=True,
                   env={**os.environ, "PXR_WORK_THREAD_LIMIT": "1"})
    server = serve(project)
    address = server.url.replace("ws:", "usdlive:") + "/"
    lists = {"files": [], "served": []}
    for number, line in enumerate(stages.read_text().splitlines()):
        root, session, *_ = line.split("\t")
        for kind, lines in lists.items():
            named = root if kind == "files" else f"{address}{pathlib.Path(root).relative_to(project)}@0"
            lines.append("\t".join([named, session, str(project), str(tmp_path / f"{kind}{number}")]))
    assert len(lists["files"]) > SEEDS / 2
    for kind, lines in lists.items():
        stages.write_text("\n".join(lines) + "\n")
        subprocess.run([os.environ["USDLIVE_BIN"], "dump", "--batch", stages], check=True,
                       env={**os.environ, "PXR_WORK_THREAD_LIMIT": "1"})
    resolved = re.compile(re.escape(address) + r"(@[^/]*/)?")
    for number in range(len(lists["files"])):
        served = resolved.sub("$BASE/", (tmp_path / f"served{number}").read_text())
        ours, theirs = json.loads(served), json.loads((tmp_path / f"files{number}").read_text())
        assert ours["prims"] and ours == theirs, lists["files"][number]


def test_unsaved_edits_and_earlier_revisions(shot):
    live = connect(shot, "ada")
    stage = live.open_stage("shot.usda")
    size = stage.GetPrimAtPath("/Chair/Seat").GetAttribute("size")
    size.Set(2.0)
    live.flush()
    before = live.revision
    live.create_checkpoint("two")
    size.Set(3.0)
    live.flush()
    flattened = {
        "now": run("flatten", shot.url, "shot.usda"),
        "revision": run("flatten", f"{shot.url}/shot.usda", "--revision", str(before)),
        "checkpoint": run("flatten", shot.url, "shot.usda", "--checkpoint", "two"),
        "address": run("flatten", shot.url.replace("ws:", "usdlive:") + f"/shot.usda@{before}"),
    }
    shown = {}
    for name, text in flattened.items():
        layer = Sdf.Layer.CreateAnonymous()
        assert layer.ImportFromString(text)
        shown[name] = layer.GetAttributeAtPath("/Chair/Seat.size").default
    assert shown == {"now": 3, "revision": 2, "checkpoint": 2, "address": 2}
    assert run("tree", "--composed", shot.url, "shot.usda") == "Chair  Xform\n  Seat  Cube\n"
    [chair] = json.loads(run("tree", "--composed", shot.url, "shot.usda", "--json"))
    assert chair["children"][0]["path"] == "/Chair/Seat"
    live.close()


def test_one_of_several_projects(tmp_path, serve):
    for name in ("one", "two words"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "a@b.usda").write_text(f'#usda 1.0\ndef "{name[:3].capitalize()}"\n{{\n}}\n')
    server = serve(tmp_path / "one", str(tmp_path / "two words"))
    assert run("tree", "--composed", f"{server.url}/one", "a@b.usda") == "One\n"
    assert run("tree", "--composed", f"{server.url}/two%20words", "a@b.usda") == "Two\n"
    assert run("tree", "--composed", f"{server.url}/one/a@b.usda") == "One\n"
    assert "several projects" in refused("flatten", server.url, "a@b.usda")
    assert "three" in refused("tree", "--composed", f"{server.url}/three", "a@b.usda")


def test_what_cannot_be_composed_says_why(shot, tmp_path):
    assert "gone.usda@0': there is no such file" in refused("tree", "--composed", shot.url, "gone.usda")
    (tmp_path / "bad.usda").write_text('#usda 1.0\ndef "A" {\n')
    said = refused("tree", "--composed", str(tmp_path / "bad.usda"))
    assert said.count("bad.usda:3:1: Expected }") == 1 and "Parser" not in said and "Error" not in said, said
    assert "no checkpoint 'lunch'" in refused("flatten", shot.url, "shot.usda", "-c", "lunch")
    assert "the newest revision is 0" in refused("flatten", shot.url, "shot.usda", "-r", "9")
    assert "ws://HOST:PORT" in refused("flatten", "dds://project", "shot.usda")
    assert "a revision belongs to a layer of a server" in usage_error("flatten", "shot.usda", "-r", "9")
    assert "--revision" in usage_error("dump", "--batch", "list", "-r", "9") and "--json" in usage_error("flatten", "--json", "a")
    assert "FILE" in usage_error("flatten") and "URL LAYER" in usage_error("dump", shot.url)
    assert "FILE" in usage_error("tree", "--composed", shot.url)
    shot.kill()
    assert "cannot reach" in refused("tree", "--composed", shot.url, "shot.usda")
