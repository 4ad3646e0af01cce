"""Tests named revisions (CP1, CP2): by command, from Python, by Kit's names."""

import asyncio

import pytest
from conftest import connect, refused, run
from pxr import Sdf

import usdlive
from usdlive.omni.kit.app import get_app
from usdlive.omni.kit.usd.layers import LayerUtils
from usdlive.omni.usd import create_context, destroy_context

ROOT = '#usda 1.0\n\ndef "World"\n{\n    double x = 0\n}\n'


@pytest.fixture
def served(project, serve):
    (project / "shot.usda").write_text(ROOT)
    (project / "later.usda").write_text(ROOT)
    return serve(project)


def write(layer: Sdf.Layer, value: float) -> None:
    layer.GetAttributeAtPath("/World.x").default = value


def test_checkpoints_by_command(served):
    assert "open a layer first" in refused("checkpoint", served.url, "start")
    with connect(served, "ada") as ada:
        layer = ada.open_layer("shot.usda")
        write(layer, 1.0)
        assert ada.flush()
        assert "lunch" in run("checkpoint", served.url, "lunch")
        write(layer, 2.0)
        assert ada.flush()
        run("checkpoint", served.url, "Zoë's dinner")
        ada.open_layer("later.usda")
    listed = run("checkpoints", served.url).splitlines()
    assert [line.split("  ")[-1] for line in listed] == ["lunch", "Zoë's dinner"]
    assert "x = 1" in run("cat", f"{served.url}/shot.usda", "--checkpoint", "lunch")
    assert "x = 2" in run("cat", f"{served.url}/shot.usda", "-c", "Zoë's dinner")
    assert "World" in run("tree", f"{served.url}/later.usda", "-c", "lunch"), "as it was opened first"
    assert "there is a checkpoint 'lunch'" in refused("checkpoint", served.url, "lunch")
    assert "no checkpoint 'supper'" in refused("cat", f"{served.url}/shot.usda", "-c", "supper")
    assert "1 to 200 bytes" in refused("checkpoint", served.url, "x" * 201)


@pytest.mark.parametrize("backend", ["fast", "portable"])
def test_acknowledged_edits_survive_a_kill(served, backend):
    made = []
    with connect(served, "ada", backend) as ada:
        layer = ada.open_layer("shot.usda")
        for number in range(20):
            write(layer, number)
            made.append(ada.create_checkpoint(f"number {number}"))
            if number % 5 == 4:
                served.kill()
                assert ada.wait(lambda: not ada.connected)
                served.start()
                assert ada.wait(lambda: ada.connected)
        assert ada.checkpoints() == made
        assert [one.user for one in made] == ["ada"] * 20
        assert [one.revision for one in made] == sorted({one.revision for one in made})
        with pytest.raises(usdlive.Error, match="checkpointExists"):
            ada.create_checkpoint("number 3")
    for number, one in enumerate(made):
        text = run("cat", f"{served.url}/shot.usda", "--revision", str(one.revision))
        layer = Sdf.Layer.CreateAnonymous(".usda")
        assert layer.ImportFromString(text)
        assert layer.GetAttributeAtPath("/World.x").default == number


def test_kits_checkpoints(served, tmp_path):
    local = tmp_path / "local.usda"
    local.write_text(ROOT)
    outside = Sdf.Layer.FindOrOpen(str(local))

    async def use():
        context = create_context("checkpoints", user="ada")
        assert await context.open_stage_async(f"{served.url}/shot.usda") == (True, "")
        stage = context.get_stage()
        root = stage.GetRootLayer()
        stage.GetAttributeAtPath("/World.x").Set(1.0)
        done, failed = await LayerUtils.create_checkpoint_async([root.identifier, outside.identifier, "none.usda"],
                                                                "before lunch")
        assert (done, failed) == ([root.identifier], [outside.identifier, "none.usda"])
        # The revision has a checkpoint already: the call succeeds without a new one. `force` creates another.
        assert await LayerUtils.create_checkpoint_async(root.identifier, "again") == ([root.identifier], [])
        assert await LayerUtils.create_checkpoint_async(root.identifier, "before lunch", force=True) == (
            [root.identifier], [])
        stage.GetAttributeAtPath("/World.x").Set(2.0)
        assert await LayerUtils.create_checkpoint_for_stage_async(stage, "") == ([root.identifier], [])
        await context.save_stage_async()
        await get_app().next_update_async()
        assert await LayerUtils.create_checkpoint_for_stage_async(stage, "", only_dirty_layers=True) == ([], [])
        stage.GetAttributeAtPath("/World.x").Set(3.0)
        assert await LayerUtils.create_checkpoint_for_stage_async(stage, "", only_dirty_layers=True) == (
            [root.identifier], [])
        stage.GetAttributeAtPath("/World.x").Set(4.0)
        LayerUtils.create_checkpoint(root.identifier, "a\nb" + "é" * 200)
        while len(context.live.checkpoints()) < 5:
            await asyncio.sleep(0.01)
        assert await context.close_stage_async() == (True, "")
        assert await context.create_checkpoint_async("x") == (False, "only a live project has checkpoints")

    try:
        asyncio.run(use())
    finally:
        destroy_context("checkpoints")
    with connect(served, "bo") as bo:
        names = [one.name for one in bo.checkpoints()]
    assert names[:4] == ["before lunch", "before lunch (2)", "checkpoint", "checkpoint (2)"]
    assert names[4].startswith("a b") and len(names[4].encode()) <= 180
    assert "x = 1" in run("cat", f"{served.url}/shot.usda", "-c", "before lunch (2)")
    assert "x = 2" in run("cat", f"{served.url}/shot.usda", "-c", "checkpoint")
