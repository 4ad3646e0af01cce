"""Tests what viewers of the page ask and edit."""

import numpy
import pytest
from conftest import cat, run

ROOT = """#usda 1.0
(
    subLayers = [@./anim.usda@]
    upAxis = "Y"
)

def Xform "World"
{
    def Sphere "Ball" (
        doc = "<b>a ball</b>"
        variants = {
            string look = "plain"
        }
        prepend variantSets = "look"
    )
    {
        double radius = 2
        double3 xformOp:translate = (1, 2, 3)
        uniform token[] xformOpOrder = ["xformOp:translate"]
        rel proxyPrim = </World/Box>
        variantSet "look" = {
            "plain" {
                color3f[] primvars:displayColor = [(1, 0, 0)]
            }
            "green" {
                color3f[] primvars:displayColor = [(0, 1, 0)]
            }
        }
    }

    def Cube "Box"
    {
    }
}
"""
ANIM = """#usda 1.0

over "World"
{
    over "Box"
    {
        double size = 4
    }
}
"""


@pytest.fixture
def served(project, serve):
    (project / "root.usda").write_text(ROOT)
    (project / "anim.usda").write_text(ANIM)
    return serve(project)


@pytest.fixture
def opened(served, gateway, page):
    return page(gateway(served), {"name": "vera"})


def local(matrix) -> list[float]:
    return numpy.array(matrix, float)[:, :3].reshape(-1).tolist()


def translated(x, y, z) -> list[float]:
    return [1, 0, 0, 0, 1, 0, 0, 0, 1, x, y, z]


def newest(page) -> int:
    return page.ask("log", limit=1)["commits"][0]["revision"]


def test_the_tree_and_the_properties_of_a_prim(opened):
    tree = opened.ask("children", path="/World")
    assert [one["name"] for one in tree["items"]] == ["Box", "Ball"] and tree["total"] == 2
    assert tree["items"][1]["hasVariants"] and tree["items"][1]["type"] == "Sphere"
    assert [one["path"] for one in opened.ask("search", text="bal", limit=5)["items"]] == ["/World/Ball"]
    ball = opened.ask("properties", path="/World/Ball")
    named = {one["name"]: one for one in ball["properties"]}
    assert ball["documentation"] == "<b>a ball</b>"
    assert ball["variants"] == [{"set": "look", "selection": "plain", "choices": ["green", "plain"]}]
    assert named["radius"]["value"] == 2 and named["radius"]["opinions"][0]["layer"] == "root.usda"
    assert named["proxyPrim"]["relationship"] and named["proxyPrim"]["targets"] == ["/World/Box"]
    assert set(named["visibility"]["allowed"]) == {"inherited", "invisible"}
    box = {one["name"]: one for one in opened.ask("properties", path="/World/Box")["properties"]}
    assert [one["layer"] for one in box["size"]["opinions"]] == ["anim.usda"]
    with pytest.raises(RuntimeError, match="NotFound"):
        opened.ask("properties", path="/World/Nothing")
    with pytest.raises(RuntimeError, match="Unsupported"):
        opened.ask("nonsense")


def test_an_edit_of_a_viewer_is_attributed_to_them_and_undone(opened, served, editor):
    ada = editor(served, "ada", "root.usda")
    opened.ask("set", path="/World/Ball", name="radius", value=3.5)
    ada.run("assert live.wait(lambda: stage.GetAttributeAtPath('/World/Ball.radius').Get() == 3.5, 20)")
    commit = opened.ask("log", limit=1)["commits"][0]
    assert commit["user"] == "vera" and commit["text"] == "Set /World/Ball" and commit["paths"] == ["/World/Ball"] and commit["layers"] == ["root.usda"]
    opinion = opened.ask("opinions", path="/World/Ball", name="radius")["opinions"][0]
    assert opinion["author"] == "vera" and opinion["revision"] == commit["revision"]
    assert any(one["user"] == "vera" and one["path"] == "/World/Ball.radius" for one in opened.ask("blame", path="/World/Ball")["items"])
    assert opened.ask("undo")["done"]
    ada.run("assert live.wait(lambda: stage.GetAttributeAtPath('/World/Ball.radius').Get() == 2, 20)")
    assert opened.ask("redo")["done"]
    ada.run("assert live.wait(lambda: stage.GetAttributeAtPath('/World/Ball.radius').Get() == 3.5, 20)")
    # Each goes to the layer that has the strongest opinion.
    opened.ask("set", path="/World/Box", name="size", value=6)
    ada.run("assert live.wait(lambda: stage.GetAttributeAtPath('/World/Box.size').Get() == 6, 20)")
    assert "double size = 6" in cat(served, "anim.usda") and "size" not in cat(served, "root.usda")


def test_a_drag_is_one_commit_that_others_see_before(opened, served, editor):
    ada = editor(served, "ada", "root.usda")
    before = newest(opened)
    for step in range(1, 6):
        opened.ask("transform", path="/World/Ball", matrix=translated(step, 0, 0), commit=False)
    ada.run("assert live.wait(lambda: stage.GetAttributeAtPath('/World/Ball.xformOp:translate').Get()[0] == 5, 20)")
    assert newest(opened) == before
    opened.ask("transform", path="/World/Ball", matrix=translated(6, 0, 0), commit=True)
    opened.wait(lambda page: page.at("/World/Ball")["matrix"][9] == 6)
    ada.run("assert live.wait(lambda: stage.GetAttributeAtPath('/World/Ball.xformOp:translate').Get()[0] == 6, 20)")
    opened.wait(lambda page: newest(page) > before)
    ada.flush()
    assert newest(opened) == before + 1
    opened.ask("undo")
    opened.wait(lambda page: page.at("/World/Ball")["matrix"][9] == 1)


def test_visibility_variants_and_activation(opened, served):
    opened.ask("visibility", path="/World/Ball", visible=False)
    opened.wait(lambda page: not page.at("/World/Ball")["visible"])
    opened.ask("variant", path="/World/Ball", set="look", choice="green")
    opened.wait(lambda page: page.at("/World/Ball").get("color") == [0, 1, 0])
    opened.ask("activate", path="/World/Box", active=False)
    opened.wait(lambda page: not page.has("/World/Box"))
    opened.ask("activate", path="/World/Box", active=True)
    opened.wait(lambda page: page.has("/World/Box"))
    with pytest.raises(RuntimeError, match="no variant"):
        opened.ask("variant", path="/World/Ball", set="look", choice="none")


def test_locks_mutes_and_checkpoints(opened, served, editor):
    editor(served, "ada", "root.usda")
    opened.ask("lock", layer="anim.usda", locked=True)
    stack = lambda page: page.messages["layers"]["stack"][0]
    opened.wait(lambda page: "layers" in page.messages and stack(page)["children"][0]["lockedBy"] == "vera")
    assert "ada" in stack(opened)["openBy"]
    opened.ask("mute", layer="anim.usda", muted=True)
    opened.wait(lambda page: stack(page)["children"][0]["muted"])
    opened.wait(lambda page: page.drawn(page.at("/World/Box")).max() == 1)
    opened.ask("checkpoint", name="lunch")
    assert [one["name"] for one in opened.ask("checkpoints")["items"]] == ["lunch"]


def test_a_refusal_comes_back(opened, served, editor):
    ada = editor(served, "ada", "root.usda")
    opened.ask("set", path="/World/Ball", name="radius", value=3)
    ada.run("live.lock('root.usda')")
    ada.flush()
    opened.wait(lambda page: page.messages.get("layers", {}).get("stack", [{}])[0].get("lockedBy") == "ada")
    with pytest.raises(RuntimeError, match="forbidden.*may not edit /World/Ball"):
        opened.ask("set", path="/World/Ball", name="radius", value=4)
    assert "radius = 3" in cat(served, "root.usda")


@pytest.mark.parametrize("name, value", [("radius", "big"), ("radius", [1]), ("radius", True),
                                         ("xformOp:translate", [1, 2]), ("visibility", 1), ("none", 1)])
def test_wrong_values_are_refused(opened, name, value):
    with pytest.raises(RuntimeError, match="invalidArgument|NotFound"):
        opened.ask("set", path="/World/Ball", name=name, value=value)


def test_history_is_shown_and_reverted(opened, served, editor):
    for radius in (3, 4, 5):
        opened.ask("set", path="/World/Ball", name="radius", value=radius)
        opened.wait(lambda page: page.ask("properties", path="/World/Ball") and
                    [one for one in page.ask("properties", path="/World/Ball")["properties"] if one["name"] == "radius"][0]["value"] == radius)
    newest = opened.ask("log", limit=1)["commits"][0]["revision"]
    dry = opened.ask("revert", revisions=[newest], dryRun=True)
    assert dry["edits"] == 1 and "radius" in dry["lines"][0]
    assert "radius = 5" in cat(served, "root.usda")
    opened.complete = False
    opened.ask("past", revision=newest - 1)
    opened.opened()
    assert opened.messages["state"]["past"] == newest - 1
    assert abs(opened.drawn(opened.at("/World/Ball"))[:, 0]).max() == pytest.approx(5)
    with pytest.raises(RuntimeError, match="past"):
        opened.ask("set", path="/World/Ball", name="radius", value=9)
    opened.ask("past", revision=newest - 2)
    opened.wait(lambda page: abs(page.drawn(page.at("/World/Ball"))[:, 0]).max() == pytest.approx(4))
    opened.ask("past", revision=None)
    opened.wait(lambda page: page.messages["state"]["past"] is None and page.complete and
                abs(page.drawn(page.at("/World/Ball"))[:, 0]).max() == pytest.approx(6))
    reverted = opened.ask("revert", revisions=[newest], dryRun=False)
    assert reverted["edits"] == 1
    opened.wait(lambda page: abs(page.drawn(page.at("/World/Ball"))[:, 0]).max() == pytest.approx(5))
    assert "vera" in run("log", f"{served.url}/root.usda")
