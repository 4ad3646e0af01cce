"""Stages of the past: `Live.open_stage(at=)` and `Live.player()` (docs/history.md)."""

import random
import time

import pytest
from conftest import cat, connect, error_elsewhere, refused_in_a_notice, run, wait, without_answers
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


@pytest.fixture(params=["fast", "portable"])
def backend(request):
    return request.param


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


def test_a_stage_of_the_past_is_that_of_the_files_of_then(server, tmp_path, backend):
    with connect(server, "ada", backend) as live:
        revisions = history(live)
        for at in range(revisions[0], live.revision + 1):
            past = live.open_stage("shot.usda", at=at)
            assert composed(past) == composed(exported(server, tmp_path, at)), at
            assert past.GetRootLayer().ExportToString() == cat(server, "shot.usda", "--revision", str(at))
        assert "/World/Ball" in composed(live.open_stage("shot.usda", at="lunch"))
        assert "/World/Planet" in composed(live.open_stage("shot.usda"))


def test_it_refuses_edits_and_stays_as_it_is(server, backend):
    with connect(server, "ada", backend) as live:
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


def test_a_payload_that_is_loaded_later_is_of_then_and_refuses_edits(server, backend):
    with connect(server, "ada", backend) as live:
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


def test_layers_that_were_muted_for_everybody_then_are_muted(server, backend):
    with connect(server, "ada", backend) as live:
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


def test_a_revision_that_cannot_be_read_is_an_error_that_says_which_can(server, backend):
    with connect(server, "ada", backend) as live:
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
        assert "1.5 is neither a revision" in code("shot.usda", at=1.5)[1]
        assert code("none.usda", at=1)[0] == "layerNotFound"
        checkpoint = next(one for one in live.checkpoints() if one.name == "lunch")
        run("compact", server.url, "--days", "0")  # not beyond the checkpoint
        with connect(server, "bo", backend) as later:
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


def test_a_stage_of_the_past_has_its_big_values_and_layers_that_are_gone(server, backend):
    with connect(server, "ada", backend) as live:
        stage = live.open_stage("shot.usda")
        cloud = live.create_layer("fx/cloud.usda")
        with Sdf.ChangeBlock():
            prim = Sdf.CreatePrimInLayer(cloud, "/World/Cloud")
            Sdf.AttributeSpec(prim, "points", Sdf.ValueTypeNames.DoubleArray).default = [float(one) for one in range(100_000)]
        assert live.flush()
        stage.GetRootLayer().subLayerPaths.append("fx/cloud.usda")
        assert live.flush()
        at = live.revision
        cloud.GetPrimAtPath("/World/Cloud").properties["points"].default = [1.0]
        stage.GetRootLayer().subLayerPaths.remove("fx/cloud.usda")
        assert live.flush()
    with connect(server, "bo", backend) as live:
        past = live.open_stage("shot.usda", at=at)
        points = past.GetAttributeAtPath("/World/Cloud.points").Get()
        assert len(points) == 100_000 and points[99_999] == 99_999.0
        assert not live.open_stage("shot.usda").GetPrimAtPath("/World/Cloud")


def test_it_needs_addresses(server):
    with usdlive.connect(server.url, user="ada", addresses=False) as live:
        live.open_layer("shot.usda")
        with pytest.raises(usdlive.Error, match="addresses"):
            live.open_stage("shot.usda", at=1)


# --- the player


def test_a_player_that_goes_forth_and_back_shows_what_a_stage_of_then_shows(server):
    with connect(server, "ada") as live:
        revisions = history(live)
        rename_much(live)
        newest = live.revision
        expected = {at: (composed(past := live.open_stage("shot.usda", at=at)), past.GetRootLayer().ExportToString())
                    for at in range(revisions[0], newest + 1)}
    with connect(server, "bo") as live:
        live.open_stage("shot.usda")
        now = composed(live.open_stage("shot.usda"))
        chance = random.Random(7)
        with live.player("shot.usda") as player:
            assert (player.first, player.last, player.revision) == (1, newest, newest)
            for step in range(200):
                at = chance.choice(list(expected))
                player.seek(at)
                assert player.revision == at
                here = composed(player.stage)
                assert here == expected[at][0], (step, at)
                assert player.stage.GetRootLayer().ExportToString() == expected[at][1], (step, at)
                if step % 20 == 0:  # a new stage composes the same
                    assert composed(Usd.Stage.Open(player.stage.GetRootLayer())) == here
        assert composed(live.open_stage("shot.usda")) == now and live.revision == newest, "the live layers were not touched"


def rename_much(live, count=60) -> None:
    """Commits of moves, deletes, orders and values at random."""
    chance, stage = random.Random(3), live.open_stage("shot.usda")
    shot = stage.GetRootLayer()
    shot.subLayerPaths = ["sub/look.usda"]
    for number in range(count):
        names = [str(one.path) for one in shot.GetPrimAtPath("/World").nameChildren]
        choice = chance.randrange(5)
        if choice == 0 or not names:
            stage.DefinePrim(f"/World/New{number}").GetReferences().AddReference("props/chair.usda", "/Chair")
        elif choice == 1:
            shot.GetPrimAtPath(chance.choice(names)).name = f"Renamed{number}"
        elif choice == 2 and len(names) > 2:
            stage.RemovePrim(chance.choice(names))
        elif choice == 3:
            stage.GetPrimAtPath(chance.choice(names)).SetMetadata("comment", str(number))
        else:
            shot.GetPrimAtPath("/World").nameChildrenOrder = chance.sample([Sdf.Path(one).name for one in names], len(names))
        assert live.flush()


def test_a_player_plays_while_the_editor_goes_on(server):
    with connect(server, "ada") as live:
        revisions = history(live)
        stage = live.open_stage("shot.usda")
        player = live.player("shot.usda", at=revisions[1])
        assert not player.playing and player.tick() is False
        player.play(speed=1e9)
        shown = [player.revision]

        def frame():
            stage.GetPrimAtPath("/World").SetMetadata("comment", str(min(len(shown), 5)))  # it ends once
            live.tick()
            if player.tick():
                shown.append(player.revision)
                assert composed(player.stage) == composed(live.open_stage("shot.usda", at=player.revision))
            return not player.playing

        last = player.last
        assert live.wait(frame)
        assert player.revision >= last and shown == sorted(shown)
        assert live.flush() and stage.GetPrimAtPath("/World").GetMetadata("comment")
        player.play(speed=-1e9)
        assert live.wait(lambda: (player.tick(), not player.playing)[1])
        assert player.revision == player.first
        player.seek(revisions[3])
        player.play(speed=1e-9)
        for _ in range(20):
            live.tick()
            player.tick()
        assert player.playing and player.revision == revisions[3], "no commit is due yet"
        player.play(0)
        assert not player.playing
        player.close()


def test_layers_and_big_values_that_come_later_in_the_history(server):
    with connect(server, "ada") as live:
        stage = live.open_stage("shot.usda")
        start = live.revision
        fx = live.create_layer("fx.usda")
        with Sdf.ChangeBlock():
            prim = Sdf.CreatePrimInLayer(fx, "/World/Cloud")
            prim.GetPrimAtPath("/World")
            Sdf.AttributeSpec(prim, "points", Sdf.ValueTypeNames.DoubleArray).default = [float(one) for one in range(100_000)]
        assert live.flush()
        stage.GetRootLayer().subLayerPaths.append("fx.usda")
        assert live.flush()
        end = live.revision
    with connect(server, "bo") as live:
        player = live.player("shot.usda", at=start)
        for _ in range(2):
            assert not player.stage.GetPrimAtPath("/World/Cloud")
            player.seek(end)
            points = player.stage.GetAttributeAtPath("/World/Cloud.points").Get()
            assert len(points) == 100_000 and points[99_999] == 99_999.0
            player.seek(start)


def test_its_layers_refuse_edits_and_two_players_have_their_own(server):
    with connect(server, "ada") as live:
        revisions = history(live)
        one, two = live.player("shot.usda", at=revisions[0]), live.player("shot.usda", at=revisions[-1])
        used = [layer for layer in one.stage.GetUsedLayers() if not layer.anonymous]
        assert len(used) == 3 and not any(layer.permissionToEdit for layer in used)
        assert live.layer_name(used[0]) is None
        newest = live.revision
        one.seek(revisions[2])
        assert not any(layer.permissionToEdit for layer in used)
        assert composed(two.stage) == composed(live.open_stage("shot.usda", at=revisions[-1]))
        assert live.flush() and live.revision == newest


def test_moving_writes_only_what_differs(server):
    with connect(server, "ada") as live:
        stage = live.open_stage("shot.usda")
        radius = stage.GetAttributeAtPath("/World/Ball.radius")
        revisions = []
        for value in (2.0, 3.0, 4.0):
            radius.Set(value)
            assert live.flush()
            revisions.append(live.revision)
        stage.GetRootLayer().GetPrimAtPath("/World/Ball").name = "Planet"
        assert live.flush()
        player, changes = live.player("shot.usda"), []

        def changed(notice, _):
            changes.append((sorted(map(str, notice.GetResyncedPaths())), sorted(map(str, notice.GetChangedInfoOnlyPaths()))))

        key = Tf.Notice.Register(Usd.Notice.ObjectsChanged, changed, player.stage)
        for at in (revisions[2], revisions[0], revisions[1]):
            player.seek(at)
        key.Revoke()
        assert "/World/Ball" in changes[0][0] and changes[1:] == [([], ["/World/Ball.radius"])] * 2


def test_without_addresses(server):
    with usdlive.connect(server.url, user="ada", addresses=False) as live:
        revisions = history(live)
        with live.player("shot.usda") as player:
            for at in (revisions[1], revisions[6]):
                player.seek(at)
                with connect(server, "bo") as other:
                    assert composed(player.stage) == composed(other.open_stage("shot.usda", at=at))


def test_a_player_far_away_in_a_long_history(server):
    """A jump over more commits than are read reads the layers."""
    with connect(server, "ada") as live:
        stage = live.open_stage("shot.usda")
        ball = stage.GetAttributeAtPath("/World/Ball.radius")
        assert live.flush()
        first = live.revision
        for number in range(5_000):
            ball.Set(float(number))
            live.tick()
            while live.pending > 500:
                live.tick()
        assert live.flush()
        player = live.player("shot.usda")
        for at in (first + 1, first + 4_900, first + 2_600, first + 500, first + 900, first + 5_000):
            player.seek(at)
            assert player.stage.GetAttributeAtPath("/World/Ball.radius").Get() == at - first - 1


def test_a_player_that_is_closed_or_offline_says_so(server):
    live = connect(server, "ada")
    revisions = history(live)
    player, other = live.player("shot.usda", at=revisions[0]), live.player("shot.usda", at=revisions[0])

    def code(call, *arguments):
        with pytest.raises(usdlive.Error) as raised:
            call(*arguments)
        return raised.value.code

    assert code(player.seek, 0) == code(player.seek, "supper") == "invalidArgument"
    assert code(player.seek, player.last + 1) == "futureRevision"
    assert player.revision == revisions[0]
    assert error_elsewhere(lambda: player.seek(revisions[1])).code == "invalidArgument"
    assert refused_in_a_notice(lambda: player.seek(revisions[1]), live, server).code == "invalidArgument"
    # A notice of its own layers.
    said = []

    def changed(*_):
        try:
            player.seek(revisions[0])
        except usdlive.Error as error:
            said.append(error.code)
        other.close()

    key = Tf.Notice.RegisterGlobally(Sdf.Notice.LayersDidChange, changed)
    player.seek(revisions[2])
    key.Revoke()
    assert said and set(said) == {"invalidArgument"} and player.revision == revisions[2]
    assert other.closed and code(other.seek, 1) == "notConnected"
    # Closed by a notice while it moves: after that.
    third = live.player("shot.usda", at=revisions[0])
    key = Tf.Notice.RegisterGlobally(Sdf.Notice.LayersDidChange, lambda *_: third.close())
    assert code(third.seek, revisions[1]) == "notConnected"
    key.Revoke()
    assert third.closed and code(third.tick) == "notConnected"
    assert third.stage.GetAttributeAtPath("/World/Ball.radius").Get() == 2.0, "it had moved"
    third.close()
    # The connection is closed by a notice while its player moves: after that, too.
    with connect(server, "bo") as bo:
        fourth = bo.player("shot.usda", at=revisions[0])
        key = Tf.Notice.RegisterGlobally(Sdf.Notice.LayersDidChange, lambda *_: bo.close())
        fourth.seek(revisions[1])
        key.Revoke()
        assert bo.closed and fourth.closed
    # Offline, what is here can be shown.
    for at in (player.first, player.last, player.first, player.last):  # from a layer that it adds on, it reads again
        player.seek(at)
    server.stop()
    wait(lambda: not live.connected, live)
    player.seek(revisions[2])
    assert code(live.player, "shot.usda") == "notConnected"
    server.start()
    wait(lambda: live.connected, live)
    player.seek(player.last)
    # From a handler of events.
    at = []
    live.add_handler(lambda event: (player.seek(revisions[3]), at.append(player.revision)))
    live.open_layer("shot.usda").comment = "x"
    assert live.flush()
    assert revisions[3] in at
    before = composed(player.stage)
    live.close()
    assert player.closed and (player.first, player.last, player.revision) == (0, 0, 0)
    assert code(player.seek, 1) == code(player.tick) == "notConnected"
    player.close()
    player.close()
    assert composed(player.stage) == before


def test_a_frame_does_not_wait_for_a_silent_server(server):
    with connect(server, "ada") as live:
        revisions = history(live)
        player = live.player("shot.usda", at=revisions[0])
        with without_answers(server):
            player.play(1e9)
            for _ in range(20):
                live.tick()
                assert not player.tick() and player.playing
        assert live.wait(lambda: (player.tick(), not player.playing)[1])
        assert player.revision == revisions[-1]


def test_a_player_ends_when_its_connection_joins_another_history(server, project, tmp_path):
    with connect(server, "ada") as live:
        history(live)
        player = live.player("shot.usda")
        server.stop()
        (project / ".usdlive").rename(tmp_path / "aside")
        server.start()
        assert live.wait(lambda: live.other_history is not None, 20)
        live.join_other_history()
        assert live.wait(lambda: live.connected and live.other_history is None, 20)
        assert player.closed
        assert live.wait(lambda: live.revision > 0, 20)  # the layers are imported again
        with live.player("shot.usda") as other:
            assert composed(other.stage) == composed(live.open_stage("shot.usda"))
