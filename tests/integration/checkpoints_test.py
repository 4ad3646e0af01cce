"""Named revisions (CP1, CP2): by command, from Python."""

import pytest
from conftest import connect, refused, run
from pxr import Sdf

import usdlive

ROOT = '#usda 1.0\n\ndef "World"\n{\n    double x = 0\n}\n'


@pytest.fixture
def served(project, serve):
    (project / "shot.usda").write_text(ROOT)
    (project / "later.usda").write_text(ROOT)
    return serve(project)


def write(layer: Sdf.Layer, value: float) -> None:
    layer.GetAttributeAtPath("/World.x").default = value


def test_by_command(served):
    assert "nobody has opened a layer" in refused("checkpoint", served.url, "start")
    with connect(served, "ada") as ada:
        layer = ada.open_layer("shot.usda")
        write(layer, 1.0)
        assert ada.flush()
        assert "lunch" in run("checkpoint", served.url, "lunch")
        write(layer, 2.0)
        assert ada.flush()
        run("checkpoint", served.url, "Zoë's dinner")
        ada.open_layer("later.usda")
    told = run("checkpoints", served.url).splitlines()
    assert [line.split("  ")[-1] for line in told] == ["lunch", "Zoë's dinner"]
    assert "x = 1" in run("cat", f"{served.url}/shot.usda", "--checkpoint", "lunch")
    assert "x = 2" in run("cat", f"{served.url}/shot.usda", "-c", "Zoë's dinner")
    assert "World" in run("tree", f"{served.url}/later.usda", "-c", "lunch"), "as it was opened first"
    assert "there is a checkpoint 'lunch'" in refused("checkpoint", served.url, "lunch")
    assert "no checkpoint 'supper'" in refused("cat", f"{served.url}/shot.usda", "-c", "supper")
    assert "1 to 200 bytes" in refused("checkpoint", served.url, "x" * 201)


def test_what_is_acknowledged_survives_a_kill(served):
    made = []
    with connect(served, "ada") as ada:
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
