"""The verbs that read the history and take work back: `log`, `blame`, `diff`, `revert`, `restore` (docs/history.md)."""

import json
import os
import subprocess

import pytest
from conftest import cat, connect, refused, run, synced, wait
from pxr import Sdf, Usd

ROOT = """#usda 1.0

def Xform "World"
{
    def Sphere "Ball"
    {
        double radius = 1
        double radius.timeSamples = {
            1: 10,
        }
    }

    def Cube "Cube"
    {
        double size = 2
    }
}
"""
BALL = "ball = stage.GetPrimAtPath('/World/Ball')\n"


@pytest.fixture
def server(project, serve):
    (project / "root.usda").write_text(ROOT)
    (project / "over.usda").write_text('#usda 1.0\n\nover "World"\n{\n}\n')
    return serve(project)


@pytest.fixture
def two(server, editor):
    return server, editor(server, "ada", "root.usda"), editor(server, "bo", "root.usda")


def asked(server, verb, *words):
    return [json.loads(one) for one in run(verb, "--json", server.url, *words).splitlines()]


def frame(server, one, other, code):
    """A frame of edits of one editor, which becomes one commit."""
    one.run(BALL + code + "\nlive.tick()")
    return synced(server, one, other)[0]


def history(two):
    """Four commits of two users; ada's rename is between."""
    server, ada, bo = two
    texts = [cat(server, "root.usda")]
    for one, code in ((ada, "ball.GetAttribute('radius').Set(2.0)"),
                      (bo, "ball.GetAttribute('radius').Set(20.0, 2)"),
                      (ada, "stage.GetRootLayer().GetPrimAtPath('/World/Ball').name = 'Planet'"),
                      (bo, "stage.GetPrimAtPath('/World/Planet').GetAttribute('radius').Set(3.0)")):
        texts.append(frame(server, one, ada if one is bo else bo, code))
    return texts


def test_the_log_finds_commits_by_user_path_kind_and_time(two):
    server, *_ = two
    history(two)
    def found(*words):
        return [(one["user"], one["edits"][0]["path"]) for one in asked(server, "log", *words) if one["user"]]
    assert len(found()) == 4
    assert found("--by", "bo") == [("bo", "/World/Ball.radius"), ("bo", "/World/Planet.radius")]
    assert found("--by", "nobody") == []
    assert len(found("--by", "bo", "--by", "ada")) == 4
    assert found("--kind", "animation") == [("bo", "/World/Ball.radius")]
    assert found("--kind", "namespace") == [("ada", "/World/Ball")]
    assert len(found("--path", "/World/Planet", "root.usda")) == 4  # also under its earlier name
    assert found("--path", "/World/Cube.size", "root.usda") == []
    assert len(found("--path", "/World/Planet", "root.usda", "-n", "1")) == 1
    assert len(found("--since", "1h")) == 4 and found("--until", "1h") == [] and found("--since", "2999-01-01") == []


def test_blame_names_who_has_made_each_opinion_and_what_was_there_before(two):
    server, *_ = two
    history(two)
    made = {(one["path"], one["field"]): one for one in asked(server, "blame", "root.usda", "/World/Planet")[0]}
    assert made["/World/Planet", ""]["user"] == "ada"  # the name
    assert made["/World/Planet", "typeName"]["imported"]
    radius = made["/World/Planet.radius", "default"]
    assert (radius["user"], radius["value"], radius["before"]) == ("bo", 3.0, 2.0)
    samples = asked(server, "blame", "root.usda", "/World/Planet.radius.timeSamples")[0]
    assert [(one["user"], one["value"]) for one in samples] == [("", 10.0), ("bo", 20.0)]
    assert samples[1]["before"] is None
    assert {one["path"] for one in asked(server, "blame", "-a", "root.usda", "/World")[0]} >= {
        "/World", "/World/Cube.size", "/World/Planet.radius"}
    assert "was 2" in run("blame", server.url, "root.usda", "/World/Planet.radius")


def test_a_difference_is_what_changed_and_a_layer(two, tmp_path):
    server, *_ = two
    texts = history(two)
    [changes] = asked(server, "diff", "root.usda", "1")
    moved = [one for one in changes["edits"] if one["action"] == "move"]
    assert [(one["path"]) for one in moved] == ["/World/Ball"]  # and not deleted and created
    values = {(one["action"], one["field"]): one for one in changes["edits"] if "field" in one}
    assert values["set", "default"]["before"] == 1.0 and values["set", "default"]["value"] == 3.0
    [back] = asked(server, "diff", "root.usda", "now", "1")
    assert len(back["edits"]) == len(changes["edits"])
    # The layer over the earlier content composes to the later one, but for the rename.
    (tmp_path / "then.usda").write_text(texts[3])
    (tmp_path / "changes.usda").write_text(run("diff", "--usda", server.url, "root.usda", str(changes["to"] - 1)))
    layer = Sdf.Layer.CreateAnonymous(".usda")
    layer.subLayerPaths = [str(tmp_path / "changes.usda"), str(tmp_path / "then.usda")]
    now = Sdf.Layer.CreateAnonymous(".usda")
    now.ImportFromString(texts[4])
    assert Usd.Stage.Open(layer).Flatten().GetAttributeAtPath("/World/Planet.radius").default == 3.0
    assert now.GetAttributeAtPath("/World/Planet.radius").default == 3.0


def test_a_wrong_contribution_is_removed_without_editing_files(two):
    """Nothing has to be searched in files, and what others have done since stays."""
    server, ada, bo = two
    texts = history(two)
    planned = asked(server, "revert", "--by", "ada", "--dry-run")[0]
    assert planned["dryRun"] and {one["action"] for one in planned["edits"]} == {"move"}
    assert cat(server, "root.usda") == texts[4]
    ran = subprocess.run([os.environ["USDLIVE_BIN"], "revert", "--json", "--by", "ada", server.url], capture_output=True,
                         text=True)
    assert ran.returncode == 1 and "1 opinion stays as it is" in ran.stderr
    done = json.loads(ran.stdout)
    assert [(one["path"], one["field"], one["author"]) for one in done["kept"]] == [
        ("/World/Ball.radius", "default", "bo")]
    text = synced(server, ada, bo)[0]
    assert text == texts[4].replace("Planet", "Ball")
    for one in (ada, bo):
        one.run("check_stage()")
    # It is a commit like any other, and can be reverted, too.
    assert run("revert", server.url, str(done["revision"])).startswith("reverted root.usda: 1 edit")
    assert synced(server, ada, bo)[0] == texts[4]


def test_everything_is_reverted_exactly(two):
    server, ada, bo = two
    texts = history(two)
    run("revert", server.url, f"2-{len(texts)}")
    assert synced(server, ada, bo)[0] == texts[0]


def test_a_revert_of_one_prim_leaves_the_others(two):
    server, ada, bo = two
    frame(server, ada, bo, "ball.GetAttribute('radius').Set(5.0)\n"
                           "stage.GetPrimAtPath('/World/Cube').GetAttribute('size').Set(7.0)")
    run("revert", server.url, "--layer", "root.usda", "--path", "/World/Cube", "--since", "1h")
    text = synced(server, ada, bo)[0]
    assert "double radius = 5" in text and "double size = 2" in text


def test_what_others_use_stays_when_its_creation_is_reverted(two):
    server, ada, bo = two
    frame(server, ada, bo, "UsdGeom.Xform.Define(stage, '/World/Set')")
    frame(server, bo, ada, "UsdGeom.Cone.Define(stage, '/World/Set/Cone')")
    [plan] = asked(server, "revert", "--by", "ada", "--dry-run")
    assert plan["edits"] == [] and [one["path"] for one in plan["kept"]] == ["/World/Set/Cone"]
    assert "written below what is undone by bo" in plan["kept"][0]["reason"]


def test_a_restored_layer_is_that_of_then_for_everybody(two):
    server, ada, bo = two
    texts = history(two)
    run("checkpoint", server.url, "lunch")
    frame(server, bo, ada, "stage.RemovePrim('/World/Planet')")
    assert "Planet" in run("restore", "--dry-run", server.url, "lunch")
    run("restore", server.url, "lunch")
    assert synced(server, ada, bo)[0] == texts[4]
    run("restore", server.url, "#1", "root.usda")
    assert synced(server, ada, bo)[0] == texts[0]
    assert run("restore", server.url, "1") == "nothing to be restored\n"
    for one in (ada, bo):
        one.run("check_stage()")


def test_a_prim_is_restored_from_where_it_was(two):
    server, ada, bo = two
    history(two)
    frame(server, bo, ada, "stage.GetPrimAtPath('/World/Cube').GetAttribute('size').Set(9.0)")
    run("restore", "--path", "/World/Planet", server.url, "1", "root.usda")
    text = synced(server, ada, bo)[0]
    assert 'def Sphere "Planet"' in text and "double radius = 1" in text and "2: 20" not in text
    assert "double size = 9" in text
    frame(server, bo, ada, "stage.RemovePrim('/World/Cube')")
    run("restore", "--path", "/World/Cube", server.url, "1", "root.usda")
    assert "double size = 2" in synced(server, ada, bo)[0]
    assert "neither then nor now" in refused("restore", "--path", "/None", server.url, "1", "root.usda")


def test_large_values_come_back(two):
    server, ada, bo = two
    frame(server, ada, bo, "ball.CreateAttribute('big', Sdf.ValueTypeNames.FloatArray)")
    ada.run(BALL + "ball.GetAttribute('big').Set([float(i) for i in range(100_000)])\nassert live.flush()")
    wait(lambda: "99999" in cat(server, "root.usda"))
    before = cat(server, "root.usda")
    ada.run(BALL + "ball.GetAttribute('big').Set([1.0])\nassert live.flush()")
    wait(lambda: "99999" not in cat(server, "root.usda"))
    [last] = asked(server, "log", "-n", "1")
    run("revert", server.url, str(last["revision"]))
    assert cat(server, "root.usda") == before
    bo.run(BALL + "assert live.wait(lambda: len(ball.GetAttribute('big').Get() or ()) == 100_000, 20)")


def test_the_rules_of_the_project_apply(two):
    """A revert is an edit: a lock of somebody else refuses it, and nothing is changed."""
    server, ada, bo = two
    texts = history(two)
    run("lock", "--user", "bo", server.url, "root.usda")
    assert "locked" in refused("revert", "--user", "cy", server.url, "2-5")
    assert 'double radius = 3' in cat(server, "root.usda") and "Planet" in texts[4]


def test_a_revert_leaves_locks_as_they_are(two):
    """Only who holds a lock may end it: if the revert tried, all of it would be refused."""
    server, ada, bo = two
    texts = [cat(server, "root.usda")]
    run("lock", "--user", "ada", server.url, "over.usda")
    frame(server, ada, bo, "ball.GetAttribute('radius').Set(5.0)\n"
                           "stage.GetRootLayer().customLayerData = {'omni_layer': {'specs_locking': {'/World/Cube': 'ada'}}}")
    assert run("revert", "--user", "bo", "--by", "ada", server.url).startswith("reverted root.usda: 1 edit")
    text = synced(server, ada, bo)[0]
    assert "double radius = 1" in text and "specs_locking" in text and text != texts[0]
    assert "locked by ada" in run("ls", "-l", server.url)
    run("lock", "--user", "bo", server.url, "root.usda")
    assert "locks cannot be reverted" in refused("revert", server.url, str(asked(server, "log")[-1]["revision"]))


def test_a_history_that_begins_later_says_so(two):
    server, ada, bo = two
    history(two)
    run("compact", "--days", "0", server.url)
    base = asked(server, "stat")[0]["base"]
    assert base > 2
    frame(server, ada, bo, "stage.GetPrimAtPath('/World/Planet').GetAttribute('radius').Set(8.0)")
    assert f"the history begins at #{base}" in refused("revert", server.url, "2")
    assert f"the history begins at #{base}" in refused("diff", server.url, "root.usda", "1")
    made = asked(server, "blame", "root.usda", "/World/Planet.radius")[0]
    assert {one["field"]: one.get("user") for one in made} == {
        "": None, "custom": None, "default": "ada", "timeSamples": None, "typeName": None, "variability": None}
    assert f"before #{base + 1}" in run("blame", server.url, "root.usda", "/World/Planet.radius")


def test_work_goes_on_while_it_is_reverted(two):
    """Commits that arrive between reading and writing are looked at, too."""
    server, ada, bo = two
    history(two)
    with connect(server, "cy") as live:
        layer = live.open_layer("root.usda")
        reverting = subprocess.Popen([os.environ["USDLIVE_BIN"], "revert", "--by", "ada", server.url],
                                     stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        count = 0
        while reverting.poll() is None:
            count += 1
            layer.GetAttributeAtPath("/World/Cube.size").default = float(count)
            live.tick()
        out, error = reverting.communicate()
        assert "reverted root.usda: 1 edit" in out, (out, error)
        own = out.partition("#")[2].split()[0]
        [made] = asked(server, "log", "--from", own, "-n", "1")
        assert [one["action"] for one in made["edits"]] == ["move"]
        assert live.flush()
        live.tick()
        assert layer.GetAttributeAtPath("/World/Cube.size").default == float(count)
        assert layer.GetPrimAtPath("/World/Ball")
