"""Stages of the past: `Live.open_stage(at=)` (docs/history.md)."""

import time

import pytest
from conftest import cat, connect, error_elsewhere, refused_in_a_notice, run, wait
from pxr import Sdf, Tf, Usd

import usdlive

LAYERS = ("shot.usda", "sub/look.usda", "props/chair.usda")
SHOT = """#usda 1.0
(
    subLayers = [@sub/look.usda@]
)

def Xform "World"
{
    def Sphere "Ball"
    {
        double radius = 1
        double radius.timeSamples = {
            1: 10,
        }
    }

    def "Chair" (
        references = @props/chair.usda@</Chair>
    )
    {
    }
}
"""
LOOK = '#usda 1.0\n\nover "World"\n{\n    over "Ball"\n    {\n        string look = "red"\n    }\n}\n'
CHAIR = '#usda 1.0\n\ndef Xform "Chair"\n{\n    double height = 1\n}\n'


@pytest.fixture
def server(project, serve):
    for name, text in zip(LAYERS, (SHOT, LOOK, CHAIR)):
        (project / name).parent.mkdir(exist_ok=True)
        (project / name).write_text(text)
    return serve(project)


def layer(live, name):
    return live.opened_layer(name)


def history(live) -> list[int]:
    """Makes a history with renames, new references and new layers; returns its revisions."""
    stage = live.open_stage("shot.usda")
    shot, look, chair = (layer(live, name) for name in LAYERS)
    assert live.flush()
    made = [live.revision]

    def commit():
        time.sleep(0.005)  # each has a time of its own
        assert live.flush()
        made.append(live.revision)

    stage.GetAttributeAtPath("/World/Ball.radius").Set(2.0)
    commit()
    look.GetAttributeAtPath("/World/Ball.look").default = "blue"
    chair.GetAttributeAtPath("/Chair.height").default = 3.0
    commit()
    live.create_checkpoint("lunch")
    shot.GetPrimAtPath("/World/Ball").name = "Planet"
    commit()
    look.GetPrimAtPath("/World/Ball").name = "Planet"
    commit()
    table = live.create_layer("props/table.usda")
    with Sdf.ChangeBlock():
        prim = Sdf.CreatePrimInLayer(table, "/Table")
        prim.specifier = Sdf.SpecifierDef
        Sdf.AttributeSpec(prim, "legs", Sdf.ValueTypeNames.Int).default = 4
    commit()
    stage.DefinePrim("/World/Table").GetReferences().AddReference("props/table.usda", "/Table")
    commit()
    stage.GetAttributeAtPath("/World/Planet.radius").Set(20.0, 2)
    commit()
    stage.RemovePrim("/World/Chair")
    commit()
    shot.subLayerPaths.clear()
    commit()
    return made


def composed(stage: Usd.Stage) -> dict:
    """Everything that the stage says, without the names of layers."""
    return {str(prim.GetPath()): (
                str(prim.GetTypeName()), str(prim.GetSpecifier()),
                {one.GetName(): (str(one.GetTypeName()), one.Get(), {time: one.Get(time) for time in one.GetTimeSamples()})
                 for one in prim.GetAttributes()})
            for prim in Usd.PrimRange.Stage(stage, Usd.PrimAllPrimsPredicate)}


def exported(server, folder, revision: int) -> Usd.Stage:
    """The stage of the files that the command line tool exports at a revision, in memory of nobody else."""
    for name in LAYERS + ("props/table.usda",):
        file = folder / str(revision) / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(cat(server, name, "--revision", str(revision)))
    return Usd.Stage.Open(str(folder / str(revision) / "shot.usda"))


def test_a_stage_of_the_past_is_that_of_the_files_of_then(server, tmp_path):
    with connect(server, "ada") as live:
        revisions = history(live)
        for at in range(revisions[0], live.revision + 1):
            past = live.open_stage("shot.usda", at=at)
            assert composed(past) == composed(exported(server, tmp_path, at)), at
            assert past.GetRootLayer().ExportToString() == cat(server, "shot.usda", "--revision", str(at))
        assert "/World/Ball" in composed(live.open_stage("shot.usda", at="lunch"))
        assert "/World/Planet" in composed(live.open_stage("shot.usda"))


def test_it_refuses_edits_and_stays_as_it_is(server):
    with connect(server, "ada") as live:
        now = live.open_stage("shot.usda")
        assert live.flush()
        past = live.open_stage("shot.usda", at=live.revision, load=Usd.Stage.LoadNone)
        before = composed(past)
        revision = live.revision
        for stack in (past.GetRootLayer(), *(one for one in past.GetUsedLayers() if not one.anonymous)):
            assert not stack.permissionToEdit
        with pytest.raises(Tf.ErrorException, match="not editable|permission"):
            past.GetAttributeAtPath("/World/Ball.radius").Set(7.0)
        past.SetEditTarget(past.GetSessionLayer())  # a viewer needs it
        past.OverridePrim("/World/Ball").SetActive(False)
        past.GetSessionLayer().Clear()
        now.GetAttributeAtPath("/World/Ball.radius").Set(5.0)
        assert live.flush() and live.revision == revision + 1, "one commit: the edit of now"
        assert composed(past) == before
        assert past.GetRootLayer() != now.GetRootLayer()
    assert composed(past) == before, "also after the connection was closed"


def test_a_payload_that_is_loaded_later_is_of_then_and_refuses_edits(server):
    with connect(server, "ada") as live:
        stage = live.open_stage("shot.usda")
        stage.DefinePrim("/World/Late").GetPayloads().AddPayload("props/chair.usda", "/Chair")
        assert live.flush()
        at = live.revision
        layer(live, "props/chair.usda").GetAttributeAtPath("/Chair.height").default = 9.0
        stage.RemovePrim("/World/Chair")
        assert live.flush()
        past = live.open_stage("shot.usda", at=live.revision, load=Usd.Stage.LoadNone)
        assert not past.GetPrimAtPath("/World/Late.height")
        past.Load("/World/Late")
        assert past.GetAttributeAtPath("/World/Late.height").Get() == 9.0
        assert not any(one.permissionToEdit for one in past.GetUsedLayers() if not one.anonymous)
        past = live.open_stage("shot.usda", at=at)
        assert past.GetAttributeAtPath("/World/Late.height").Get() == 1.0


def test_layers_that_were_muted_for_everybody_then_are_muted(server):
    with connect(server, "ada") as live:
        live.open_stage("shot.usda")
        live.mute("shot.usda", "sub/look.usda")
        assert live.flush()
        at = live.revision
        live.unmute("shot.usda", "sub/look.usda")
        assert live.flush()

        def has_look(**options):
            return "look" in composed(live.open_stage("shot.usda", **options))["/World/Ball"][2]

        assert not has_look(at=at)
        assert has_look(at=at, follow_muteness=False) and has_look(at=at + 1) and has_look()


def test_a_revision_that_cannot_be_read_is_an_error_that_says_which_can(server):
    with connect(server, "ada") as live:
        def code(*arguments, **options):
            with pytest.raises(usdlive.Error) as raised:
                live.open_stage(*arguments, **options)
            return raised.value.code, str(raised.value)

        assert "no history yet" in code("shot.usda", at=1)[1]
        history(live)
        newest = live.revision

        found, text = code("shot.usda", at=newest + 1)
        assert found == "futureRevision" and f"the newest is {newest}" in text
        assert code("shot.usda", at=0)[0] == code("shot.usda", at=-1)[0] == "invalidArgument"
        assert "no checkpoint 'supper'" in code("shot.usda", at="supper")[1]
        assert code("none.usda", at=1)[0] == "layerNotFound"
        checkpoint = next(one for one in live.checkpoints() if one.name == "lunch")
        run("compact", server.url, "--days", "0")  # not beyond the checkpoint
        with connect(server, "bo") as later:
            for one in (live, later):
                live_stage = one.open_stage("shot.usda", at=checkpoint.revision)
                assert live_stage.GetAttributeAtPath("/World/Ball.radius").Get() == 2.0
                with pytest.raises(usdlive.Error, match=f"revision {checkpoint.revision - 1} cannot be read.*oldest.*{checkpoint.revision}") as raised:
                    one.open_stage("shot.usda", at=checkpoint.revision - 1)
                assert raised.value.code == "historyReplaced"
        refused = refused_in_a_notice(lambda: live.open_stage("shot.usda", at=newest), live, server)
        assert refused.code == "invalidArgument"
        assert error_elsewhere(lambda: live.open_stage("shot.usda", at=newest)).code == "invalidArgument"
        server.stop()
        wait(lambda: not live.connected, live)
        assert code("shot.usda", at=newest)[0] == "notConnected"
    with pytest.raises(usdlive.Error, match="was closed"):
        live.open_stage("shot.usda", at=1)


def test_it_needs_addresses(server):
    with usdlive.connect(server.url, user="ada", addresses=False) as live:
        live.open_layer("shot.usda")
        with pytest.raises(usdlive.Error, match="addresses"):
            live.open_stage("shot.usda", at=1)
