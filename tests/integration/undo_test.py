"""Undo and redo of one's own work, in editors that write with pxr (docs/undo.md)."""

import pytest
import usdlive
from conftest import connect, error_elsewhere, refused_in_a_notice, synced, wait
from pxr import UsdGeom

ROOT = """#usda 1.0
(
    subLayers = [
        @./over.usda@
    ]
)

def Xform "World"
{
    def Sphere "Ball" (
        apiSchemas = ["A", "B", "C"]
    )
    {
        double radius = 1
        double radius.timeSamples = {
            1: 10,
            2: 20,
        }
        rel things = [
            </World/Cube>,
            </World/Ball>,
        ]
    }

    def Cube "Cube"
    {
    }

    def Xform "Group"
    {
    }
}
"""
OVER = """#usda 1.0

over "World"
{
    over "Ball"
    {
        double size = 3
    }
}
"""

# Each is one frame of edits.
STEPS = {
    "value": "ball.GetAttribute('radius').Set(5.0)",
    "time samples": "ball.GetAttribute('radius').Set(11.0, 1); ball.GetAttribute('radius').Set(30.0, 3)",
    "cleared attribute": "ball.GetAttribute('radius').Clear()",
    "list": "ball.AddAppliedSchema('D'); ball.RemoveAppliedSchema('A')",
    "targets": "ball.GetRelationship('things').AddTarget('/World/Group');"
               "ball.GetRelationship('things').RemoveTarget('/World/Cube')",
    "dictionary": "ball.SetCustomDataByKey('a:b', 1); ball.SetCustomDataByKey('a:c', 2);"
                  "ball.ClearCustomDataByKey('a:b')",
    "reference": "ball.GetReferences().AddInternalReference('/World/Cube')",
    "variants": "s = ball.GetVariantSets().AddVariantSet('look'); s.AddVariant('one'); s.SetVariantSelection('one')",
    "order": "stage.GetPrimAtPath('/World').SetChildrenReorder(['Group', 'Ball'])",
    "created": "UsdGeom.Cone.Define(stage, '/World/New/Cone').GetHeightAttr().Set(3.0)",
    "deleted": "stage.RemovePrim('/World/Cube')",
    # Sdf reports an error for some, and reorders nevertheless.
    "placed": "e = Sdf.BatchNamespaceEdit(); e.Add(Sdf.NamespaceEdit.Reorder('/World/Group', 0))\n"
              "try: stage.GetRootLayer().Apply(e)\nexcept Exception: pass",
    "renamed": "e = Sdf.BatchNamespaceEdit(); e.Add('/World/Ball', '/World/Planet');"
               "assert stage.GetRootLayer().Apply(e)",
    "grouped": "UsdGeom.Xform.Define(stage, '/Set')\n"
               "e = Usd.NamespaceEditor(stage); e.MovePrimAtPath('/World/Ball', '/Set/Ball'); assert e.ApplyEdits()",
    "batch": "e = usdlive.NamespaceEditor(stage); e.MovePrimAtPath('/World/Ball', '/World/Group/Ball');"
             "assert e.ApplyEdits()",
    "metadata": "stage.SetStartTimeCode(1); stage.SetMetadata('comment', 'hello')",
    "sublayers": "stage.GetRootLayer().subLayerPaths.clear()",
}
FIND = "ball = stage.GetPrimAtPath('/World/Ball')\n"
UNDO = "result = [(k.path, k.field, k.author) for k in live.undo().kept]"


@pytest.fixture
def server(project, serve):
    (project / "root.usda").write_text(ROOT)
    (project / "over.usda").write_text(OVER)
    return serve(project)


@pytest.fixture
def two(server, editor):
    return server, editor(server, "ada", "root.usda"), editor(server, "bo", "root.usda")


@pytest.fixture(params=["fast", "portable"])
def both(server, editor, request):
    """Does the same for each backend of the first editor."""
    return server, editor(server, "ada", "root.usda", request.param), editor(server, "bo", "root.usda")


either = pytest.mark.parametrize("backend", ["fast", "portable"])


@pytest.mark.parametrize("step", STEPS)
def test_a_step_is_undone_and_redone_exactly(step, two):
    server, ada, bo = two
    layers = ("root.usda", "over.usda")
    before = [ada.text(layer) for layer in layers]
    ada.run(FIND + STEPS[step] + "\nlive.tick()")
    after = synced(server, ada, bo, layers=layers)
    assert after != before
    assert ada.run(UNDO + "; check_stage()") == []
    assert [ada.text(layer) for layer in layers] == before  # at once
    assert synced(server, ada, bo, layers=layers) == before
    ada.run("assert live.redo()")
    assert [ada.text(layer) for layer in layers] == after
    assert synced(server, ada, bo, layers=layers) == after
    bo.run("check_stage()")


@pytest.mark.parametrize("offline, backend", [(False, "fast"), (True, "fast"), (True, "portable")])
def test_all_steps_are_undone_and_redone_exactly(offline, backend, server, editor):
    ada, bo = editor(server, "ada", "root.usda", backend), editor(server, "bo", "root.usda")
    layers = ("root.usda", "over.usda")
    before = [ada.text(layer) for layer in layers]
    if offline:
        server.kill()
        ada.run("assert live.wait(lambda: not live.connected, 20)")
    # The last edits find no /World/Ball.
    steps = [one for one in STEPS if one not in ("renamed", "grouped", "deleted")]
    for one in steps:
        ada.run(FIND + STEPS[one] + "\nlive.tick()")
    after = [ada.text(layer) for layer in layers]
    assert ada.run("result = len(live.undo_stack().undo)") == len(steps)
    for _ in range(2):
        assert ada.run("n = 0\nwhile live.undo(): n += 1\nresult = n") == len(steps)
        assert [ada.text(layer) for layer in layers] == before
        assert ada.run("n = 0\nwhile live.redo(): n += 1\nresult = n") == len(steps)
        assert [ada.text(layer) for layer in layers] == after
    if offline:
        server.start()
    assert synced(server, ada, bo, layers=layers) == after


def test_what_a_colleague_has_written_since_is_kept_and_named(both):
    server, ada, bo = both
    ada.run(FIND + "ball.GetAttribute('radius').Set(5.0); ball.GetAttribute('radius').Set(12.0, 1)")
    synced(server, ada, bo)
    bo.run(FIND + "ball.GetAttribute('radius').Set(7.0)")
    synced(server, ada, bo)
    assert ada.run(UNDO) == [["/World/Ball.radius", "default", "bo"]]
    text, = synced(server, ada, bo)
    assert "double radius = 7" in text and "1: 10" in text


def test_a_deleted_prim_returns_with_what_a_colleague_did_before(two):
    server, ada, bo = two
    bo.run(FIND + "ball.GetAttribute('radius').Set(7.0); live.flush()")  # ada has not seen it
    ada.run("stage.RemovePrim('/World/Ball'); live.flush()")
    assert "Ball" not in synced(server, ada, bo)[0].split("def ")[2]
    ada.run("assert not live.undo().kept")
    text, = synced(server, ada, bo)
    assert "double radius = 7" in text


def test_a_rename_goes_back_with_what_a_colleague_wrote_since(two):
    server, ada, bo = two
    before = ada.text("over.usda")
    ada.run("e = usdlive.NamespaceEditor(stage); e.MovePrimAtPath('/World/Ball', '/World/Planet'); assert e.ApplyEdits()")
    synced(server, ada, bo, layers=("root.usda", "over.usda"))
    bo.run("stage.GetPrimAtPath('/World/Planet').GetAttribute('radius').Set(7.0)")
    synced(server, ada, bo)
    assert ada.run(UNDO) == []
    root, over = synced(server, ada, bo, layers=("root.usda", "over.usda"))
    assert 'def Sphere "Ball"' in root and "double radius = 7" in root and "Planet" not in root
    assert over == before
    ada.run("live.redo()")
    root, over = synced(server, ada, bo, layers=("root.usda", "over.usda"))
    assert 'def Sphere "Planet"' in root and 'over "Planet"' in over


def test_a_created_prim_stays_with_what_a_colleague_put_there(both):
    server, ada, bo = both
    ada.run("stage.DefinePrim('/Mine/A'); stage.DefinePrim('/Mine/B')")
    synced(server, ada, bo)
    bo.run("stage.DefinePrim('/Mine/A/Theirs')")
    synced(server, ada, bo)
    assert ("/Mine/A/Theirs", None, "bo") in map(tuple, ada.run(UNDO))
    text, = synced(server, ada, bo)
    assert '"Theirs"' in text and 'def "B"' not in text


@either
def test_groups_gestures_and_edits_that_are_not_ticked(server, backend):
    with connect(server, "ada", backend) as live:
        stage = live.open_stage("root.usda")
        radius = UsdGeom.Sphere(stage.GetPrimAtPath("/World/Ball")).GetRadiusAttr()
        assert not live.undo() and not live.redo()
        with live.undo_group("Move chairs"):
            for value in (2.0, 3.0):
                radius.Set(value)
                live.tick()
            with live.undo_group("inner"):
                UsdGeom.Cone.Define(stage, "/Cone")
            with pytest.raises(usdlive.Error, match="group of edits is open") as refused:
                live.undo()
            assert refused.value.code == "invalidArgument"
        with live.gesture():
            for value in (4.0, 5.0):
                radius.Set(value)
                live.tick()
            with pytest.raises(usdlive.Error, match="gesture is open"):
                live.redo()
        radius.Set(6.0)  # in the frame of the undo
        assert live.undo_stack().undo == ("Move chairs", "Edit")
        assert live.undo().label == "Edit" and radius.Get() == 5
        assert live.undo_stack().undo == ("Move chairs", "Edit") and live.undo_stack().redo == ("Edit",)
        assert live.undo() and radius.Get() == 3
        assert live.undo().label == "Move chairs" and radius.Get() == 1 and not stage.GetPrimAtPath("/Cone")
        assert live.undo_stack().redo == ("Edit", "Edit", "Move chairs")
        assert live.redo() and radius.Get() == 3 and stage.GetPrimAtPath("/Cone")
        radius.Set(8.0)
        live.tick()
        assert not live.redo() and live.undo_stack().redo == ()
        assert live.flush()


@either
def test_calls_from_wrong_places(server, backend):
    live = connect(server, "ada", backend)
    live.open_stage("root.usda")
    for call in (live.undo, live.redo, live.undo_stack):
        assert error_elsewhere(call) is not None
    live.close()
    with pytest.raises(usdlive.Error):
        live.undo()


@either
def test_a_notice_handler_cannot_undo(project, serve, backend):
    (project / "shot.usda").write_text("#usda 1.0\n")
    server = serve(project)
    with connect(server, "ada", backend) as live:
        assert "notice handler" in str(refused_in_a_notice(live.undo, live, server))


@either
def test_an_event_handler_can_undo(server, backend):
    with connect(server, "ada", backend) as live:
        stage = live.open_stage("root.usda")
        done = []
        live.add_handler(lambda event: done.append(live.undo()) if isinstance(event, usdlive.events.Committed) and
                         not done else None)
        stage.GetRootLayer().comment = "mine"
        wait(lambda: done, live)
        assert live.flush() and stage.GetRootLayer().comment == ""


def test_the_undo_of_work_in_a_locked_layer_is_lost_and_can_be_made_again(both):
    server, ada, bo = both
    ada.run("stage.GetRootLayer().comment = 'mine'; live.flush()")
    bo.run("live.lock('root.usda'); live.flush()")
    ada.run("assert live.undo(); live.flush(20)")
    ada.run("assert live.wait(lambda: any(type(e).__name__ == 'Lost' for e in happened), 20)")
    assert ada.run("result = stage.GetRootLayer().comment") == "mine"
    assert ada.run("result = [len(live.undo_stack().undo), len(live.undo_stack().redo)]") == [1, 0]
    bo.run("live.unlock('root.usda'); live.flush()")
    synced(server, ada, bo)
    ada.run("assert live.undo() and not stage.GetRootLayer().comment")
    assert "mine" not in synced(server, ada, bo)[0]


def test_the_stack_survives_a_lost_connection(both):
    server, ada, bo = both
    before = ada.text("root.usda")
    ada.run(FIND + STEPS["value"] + "; live.flush()\n" + STEPS["created"] + "; live.flush()")
    after = ada.text("root.usda")
    server.kill()
    ada.run("assert live.wait(lambda: not live.connected, 20)")
    ada.run("assert live.undo()")
    server.start()
    ada.run("assert live.wait(lambda: live.connected, 20)")
    ada.run("assert live.undo() and not live.undo()")
    assert synced(server, ada, bo) == [before]
    ada.run("assert live.redo() and live.redo()")
    assert synced(server, ada, bo) == [after]
