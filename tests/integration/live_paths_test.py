"""Tests renames, deletes and relocates of one editor and the work of another, when neither has seen the other's
(M15, M16): nothing points to a place that its object has left, and an edit of a prim is an edit of that prim.
A third editor, who comes afterwards, sees the same."""

import pytest
from conftest import synced

SCENE = {
    "root.usda": """#usda 1.0
(
    subLayers = [@./anim.usda@]
)

def "W"
{
    def "Chair"
    {
        double x = 1
        def "Leg"
        {
        }
    }

    def "Table"
    {
        rel near = </W/Chair>
        double c.connect = </W/Chair.x>
    }

    def "Ref" (
        prepend references = @./asset.usda@</A>
    )
    {
    }

    def "Room"
    {
    }
}
""",
    "anim.usda": "#usda 1.0\n",
    "asset.usda": '#usda 1.0\n\ndef "A"\n{\n    def "Part"\n    {\n        double p = 1\n    }\n}\n',
}
LAYERS = tuple(SCENE)


def move(old, new):
    return (f"e = usdlive.NamespaceEditor(stage)\ne.MovePrimAtPath({old!r}, {new!r})\n"
            "assert e.ApplyEdits(), e.GetResult().whyNot")


def delete(path):
    return f"e = usdlive.NamespaceEditor(stage)\ne.DeletePrimAtPath({path!r})\nassert e.ApplyEdits(), e.GetResult().whyNot"


KINDS = {
    "rename": move("/W/Chair", "/W/Stool"),
    "rename otherwise": move("/W/Chair", "/W/Bench"),
    "rename the parent": move("/W", "/Earth"),
    "reparent": move("/W/Chair", "/W/Room/Chair"),
    "rename a child": move("/W/Chair/Leg", "/W/Chair/Foot"),
    "delete": delete("/W/Chair"),
    "relocate": move("/W/Ref/Part", "/W/Ref/Piece"),
    "relocate otherwise": move("/W/Ref/Part", "/W/Ref/Bit"),
    "point": "stage.GetPrimAtPath('/W/Table').CreateRelationship('to').AddTarget('/W/Chair')",
    "connect": "a = stage.GetPrimAtPath('/W/Room').CreateAttribute('d', Sdf.ValueTypeNames.Double)\n"
               "a.AddConnection('/W/Chair.x')",
    "refer": "stage.DefinePrim('/W/Copy').GetReferences().AddInternalReference('/W/Chair')",
    "first key": "with Usd.EditContext(stage, layer('anim.usda')):\n"
                 "    stage.GetPrimAtPath('/W/Chair').GetAttribute('x').Set(5.0, 10.0)",
    "first key of a part": "with Usd.EditContext(stage, layer('anim.usda')):\n"
                           "    stage.GetPrimAtPath('/W/Ref/Part').GetAttribute('p').Set(5.0, 10.0)",
    "first opinion of a part": "stage.GetPrimAtPath('/W/Ref/Part').GetAttribute('p').Set(7.0)",
}

# Targets and connections that lead to nothing, prims without a definition, and errors of composition.
LOOSE = """
def loose():
    found = []
    for prim in stage.TraverseAll():
        if prim.GetSpecifier() == Sdf.SpecifierOver and prim.GetPath() != '/':
            found.append('stray ' + str(prim.GetPath()))
        for one in prim.GetRelationships():
            found += ['target ' + str(t) for t in one.GetTargets() if not stage.GetObjectAtPath(t)]
        for one in prim.GetAttributes():
            found += ['connection ' + str(t) for t in one.GetConnections() if not stage.GetObjectAtPath(t)]
    return found + [str(e) for e in stage.GetCompositionErrors()]
result = loose()
"""
LOST = "result = [e.message for e in happened if type(e).__name__ == 'Lost']"


def fill(folder):
    for name, text in SCENE.items():
        (folder / name).write_text(text)


@pytest.fixture
def scene(project, serve, editor):
    fill(project)
    server = serve(project)
    return server, editor(server, "ada", "root.usda"), editor(server, "bo", "root.usda")


def after(scene, editor, first, second):
    """Makes two edits that have not seen each other. The one of `first` is committed first."""
    server, ada, bo = scene
    synced(server, ada, bo, layers=LAYERS)
    ada.run(second)
    bo.run(first)
    bo.flush()
    synced(server, ada, bo, layers=LAYERS)
    late = editor(server, "cy", "root.usda")
    synced(server, ada, bo, late, layers=LAYERS)
    return same(ada, bo, late), ada.run(LOST), bo.run(LOST)


def same(*editors):
    """Returns what is loose, which is the same for all, and as on a newly opened stage."""
    shown = []
    for one in editors:
        one.run("check_stage(stage)")
        shown.append(one.run(LOOSE))
    assert all(one == shown[0] for one in shown)
    return shown[0]


# For a peer that has the stages of many scenes: enter() makes one of them `stage`.
ENTER = """
stages = {}
layer_of_all = layer
def enter(folder):
    global layer, stage
    layer = lambda name: layer_of_all(folder + '/' + name)
    stages[folder] = stage = stages.get(folder) or live.open_stage(folder + '/root.usda')
"""


@pytest.mark.parametrize("situation", ["online", "offline"])
@pytest.mark.parametrize("first", KINDS)
def test_nothing_dangles_after_two_edits_that_have_not_seen_each_other(first, situation, project, serve, editor):
    """Two kinds meet in both orders: in one order with a server, in the other one without."""
    at = list(KINDS).index(first)
    seconds = list(KINDS)[at:] if situation == "online" else list(KINDS)[:at + 1]
    scenes = {f"scene{number}": second for number, second in enumerate(seconds)}
    for folder in [project, *(project / name for name in scenes)]:
        folder.mkdir(exist_ok=True)
        fill(folder)
    server = serve(project)
    ada, bo, cy = peers = [editor(server, user, "root.usda") for user in ("ada", "bo", "cy")]
    for peer in peers:
        peer.run(ENTER)
    for folder in scenes:
        for peer in (ada, bo):
            peer.run(f"enter({folder!r})\nlive.flush(20)")
    if situation == "offline":
        server.stop()
    for folder, second in scenes.items():
        for peer, kind in ((ada, second), (bo, first)):  # without a tick, ada does not see what bo makes
            peer.run(f"enter({folder!r})\n{KINDS[kind]}")
            if situation == "offline":
                peer.run("live.tick()")
        if situation == "online":
            bo.flush()
            ada.flush()
    if situation == "offline":
        server.start()
        bo.flush()
    for folder in scenes:
        cy.run(f"enter({folder!r})")
    for peer in peers:
        peer.run("layer = layer_of_all")
    synced(server, *peers, layers=tuple(f"{folder}/{name}" for folder in scenes for name in SCENE))
    failed = []
    for folder, second in scenes.items():
        for peer in peers:
            peer.run(f"enter({folder!r})")
        if loose := same(*peers):
            failed.append((second, loose, ada.run(LOST), bo.run(LOST)))
    assert not failed, "\n".join(map(str, failed))


def value(editor, expression):
    return editor.run(f"result = {expression}")


# The key that the animator wrote. On the stage, the default of the layer above is stronger.
KEY = "layer('anim.usda').QueryTimeSample('/W/Stool.x', 10.0)"


def targets(editor):
    return value(editor, "[str(t) for p in stage.TraverseAll() for r in p.GetRelationships() for t in r.GetTargets()]")


def test_a_rename_and_that_of_the_parent(scene, editor):
    after(scene, editor, KINDS["rename"], KINDS["rename the parent"])
    assert targets(scene[1]) == ["/Earth/Stool"]
    assert value(scene[1], "[str(c) for c in stage.GetAttributeAtPath('/Earth/Table.c').GetConnections()]") == ["/Earth/Stool.x"]


def test_two_renames_of_one_prim(scene, editor):
    after(scene, editor, KINDS["rename otherwise"], KINDS["rename"])
    assert targets(scene[1]) == ["/W/Stool"]


def test_a_first_key_follows_a_rename(scene, editor):
    after(scene, editor, KINDS["rename"], KINDS["first key"])
    assert value(scene[1], KEY) == 5
    assert "Chair" not in scene[1].text("anim.usda")


def test_a_rename_takes_a_first_key_with_it(scene, editor):
    after(scene, editor, KINDS["first key"], KINDS["rename"])
    assert value(scene[1], KEY) == 5
    assert "Chair" not in scene[1].text("anim.usda")


def test_a_reference_follows_a_rename(scene, editor):
    after(scene, editor, KINDS["rename"], KINDS["refer"])
    assert value(scene[1], "stage.GetAttributeAtPath('/W/Copy.x').Get()") == 1


def test_a_first_opinion_follows_a_relocate(scene, editor):
    after(scene, editor, KINDS["relocate"], KINDS["first opinion of a part"])
    assert value(scene[1], "stage.GetAttributeAtPath('/W/Ref/Piece.p').Get()") == 7


def test_two_relocates_of_one_prim(scene, editor):
    after(scene, editor, KINDS["relocate otherwise"], KINDS["relocate"])
    assert value(scene[1], "[p.GetName() for p in stage.GetPrimAtPath('/W/Ref').GetChildren()]") == ["Piece"]


def test_a_relocate_and_a_rename_of_the_parent(scene, editor):
    after(scene, editor, KINDS["rename the parent"], KINDS["relocate"])
    assert value(scene[1], "[p.GetName() for p in stage.GetPrimAtPath('/Earth/Ref').GetChildren()]") == ["Piece"]


def test_a_delete_that_takes_what_its_author_had_not_seen_is_reported(scene, editor):
    _, lost_by_ada, lost_by_bo = after(scene, editor, "stage.GetAttributeAtPath('/W/Chair.x').Set(5.0)", KINDS["delete"])
    assert not lost_by_ada
    assert lost_by_bo == ["Somebody who had not seen this work has deleted what it was written to. It was ada."]
    lost = "[e for e in happened if type(e).__name__ == 'Lost'][-1].index"
    assert "double x = 5" in scene[2].run(f"result = live.lost_work_as_layer({lost}, 'root.usda').ExportToString()")


def test_a_key_for_a_deleted_prim_is_lost_and_reported(scene, editor):
    _, lost, _ = after(scene, editor, KINDS["delete"], KINDS["first key"])
    assert lost
    assert "Chair" not in scene[1].text("anim.usda")
