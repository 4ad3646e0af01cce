"""The portable backend: editors with other versions of OpenUSD, and with the one that usdlive was built for, edit one
project. What a version cannot express comes back from it unchanged."""

import os
import re

import pytest
from conftest import cat
from portable_editors import BUILT_FOR, NEWEST, OLDEST, OTHERS, ROOT, SOAKED, all_synced, plain, portable, served  # noqa: F401
from undo_test import FIND, STEPS
from undo_test import OVER as UNDO_OVER
from undo_test import ROOT as UNDO_ROOT

# Content that no portable backend shows yet. It has to keep it.
SPLINE = """
def "Curves"
{
    double animated.spline = {
        1: 5; post linear,
        3: 7; post linear,
    }
}
"""

RADIUS = "GetAttributeAtPath('/World/Ball.radius').default"

# One editor with each version, and the name of its user.
USERS = [(OLDEST, "old"), (BUILT_FOR, "fast"), (NEWEST, "new")]


@pytest.mark.parametrize("version", [BUILT_FOR, *OTHERS])
def test_a_layer_is_what_plain_openusd_reads(served, portable, version):
    server = served()
    editor = portable(server, version, "ada", "portable")
    assert editor.run("result = live.backend") == "portable"
    assert editor.text("root.usda") == plain(ROOT)
    assert editor.run("result = stage.GetPrimAtPath('/World').GetAttribute('fromBelow').Get()") == "sub"
    # Reading all of it again finds no edit.
    before = editor.flush()
    editor.run("layer().GetPrimAtPath('/World').kind = 'group'; layer().GetPrimAtPath('/World').kind = 'assembly'")
    assert editor.flush() == before
    all_synced(server, editor)


EDITS = {
    "prims": """UsdGeom.Cube.Define(stage, '/World/New').GetSizeAttr().Set(3.5)
stage.DefinePrim('/Second', 'Scope'); stage.OverridePrim('/World/Ball/Below')""",
    "numbers": """prim = stage.DefinePrim('/Types')
for number, name in enumerate(['bool', 'uchar', 'int', 'uint', 'int64', 'uint64', 'half', 'float', 'double']):
    prim.CreateAttribute(f'a{number}', Sdf.ValueTypeNames.Find(name)).Set(1)
    prim.CreateAttribute(f'b{number}', Sdf.ValueTypeNames.Find(name + '[]')).Set([0, 1, 1])
prim.CreateAttribute('third', Sdf.ValueTypeNames.Float).Set(1 / 3)
prim.CreateAttribute('big', Sdf.ValueTypeNames.UInt64).Set(2 ** 64 - 1)""",
    "vectors": """prim = stage.DefinePrim('/Vectors')
for name, value in {'float3': Gf.Vec3f(1, 2, .1), 'double2': Gf.Vec2d(1, 2), 'int4': Gf.Vec4i(1, 2, 3, 4), 'half3': Gf.Vec3h(.1, 2, 3),
                    'point3f[]': [(1, 2, 3), (4, 5, 6)], 'half2[]': [(.5, .1)], 'quatf': Gf.Quatf(1, 2, 3, 4), 'quath[]': [Gf.Quath(1, 2, 3, 4)],
                    'matrix4d': Gf.Matrix4d(2), 'matrix2d[]': [Gf.Matrix2d(1, 2, 3, 4)], 'int3[]': []}.items():
    prim.CreateAttribute('v_' + name.replace('[]', 's'), Sdf.ValueTypeNames.Find(name)).Set(value)""",
    "texts": """prim = stage.DefinePrim('/Texts')
for name, value in {'string': 'Zürich "q"\\n', 'token': 'a b', 'asset': Sdf.AssetPath('./x.png'), 'string[]': ['a', ''], 'token[]': ['t'],
                    'asset[]': [Sdf.AssetPath('a'), Sdf.AssetPath('b')]}.items():
    prim.CreateAttribute('t_' + name.replace('[]', 's'), Sdf.ValueTypeNames.Find(name)).Set(value)
prim.CreateAttribute('time', Sdf.ValueTypeNames.TimeCode).Set(2.5)""",
    "samples": """radius = stage.GetPrimAtPath('/World/Ball').GetAttribute('radius')
radius.Set(9, 7); radius.ClearAtTime(1); radius.Set(Sdf.ValueBlock(), 8)
stage.GetPrimAtPath('/World/Ball').GetAttribute('primvars:displayColor').Set([(0, 1, 0)], 4)""",
    "relationships": """prim = stage.GetPrimAtPath('/World')
prim.GetRelationship('more').AddTarget('/World/Box', Usd.ListPositionFrontOfAppendList)
prim.GetRelationship('targets').SetTargets(['/Class'])
prim.CreateRelationship('empty').SetTargets([])
layer().GetRelationshipAtPath('/World.more').targetPathList.deletedItems.append('/Gone')
stage.GetPrimAtPath('/World/Box').GetAttribute('size').AddConnection('/World/Ball.radius')""",
    "variants": """sets = stage.GetPrimAtPath('/World').GetVariantSets()
look = sets.GetVariantSet('look'); look.AddVariant('zebra'); look.SetVariantSelection('zebra')
with look.GetVariantEditContext():
    stage.DefinePrim('/World/Striped', 'Cone')
    stage.GetPrimAtPath('/World').CreateAttribute('stripes', Sdf.ValueTypeNames.Int).Set(4)
other = sets.AddVariantSet('size'); other.AddVariant('big'); other.SetVariantSelection('big')""",
    "arcs": """prim = stage.DefinePrim('/Arcs')
prim.GetReferences().AddReference('./sub.usda', '/World', Sdf.LayerOffset(4, 2))
prim.GetPayloads().AddPayload('./sub.usda', '/World')
prim.GetInherits().AddInherit('/Class'); prim.GetSpecializes().AddSpecialize('/Class')
prim.AddAppliedSchema('MyAPI')
stage.GetPrimAtPath('/World/Ball').GetReferences().AddInternalReference('/Second')""",
    "metadata": """prim = stage.GetPrimAtPath('/World')
prim.SetMetadata('hidden', True); prim.SetDocumentation('new'); Usd.ModelAPI(prim).SetKind('group')
stage.GetPrimAtPath('/World/Ball').SetInstanceable(True)
stage.SetStartTimeCode(1); stage.SetMetadata('metersPerUnit', 0.01); stage.ClearMetadata('upAxis')
attribute = layer().GetAttributeAtPath('/World/Box.size'); attribute.displayName = 'Size'; attribute.customData = {'x': Vt.Float(.1)}
attribute.allowedTokens = ['a', 'b']; attribute.displayGroup = 'Group'
layer().GetPrimAtPath('/World').nameChildrenOrder = ['Box', 'Ball']; prim.SetActive(False)""",
    "custom data": """prim = stage.GetPrimAtPath('/World')
prim.SetCustomDataByKey('added:deep', 'text'); prim.ClearCustomDataByKey('b'); prim.SetCustomDataByKey('h', Vt.Half(0.25))
prim.SetCustomDataByKey('list', Vt.TokenArray(['a', 'b'])); prim.SetCustomDataByKey('f', Vt.Float(1 / 3)); prim.SetCustomDataByKey('d', 1 / 3)
layer().customLayerData = {**layer().customLayerData, 'new': {'u': Vt.UChar(7), 'at': Sdf.AssetPath('z')}}""",
    "delete": """stage.RemovePrim('/World/Box'); stage.GetPrimAtPath('/World/Ball').RemoveProperty('noise')
layer().GetPrimAtPath('/World').variantSets['look'].RemoveVariant(layer().GetObjectAtPath('/World{look=blue}'))""",
    "rename": """edit = Sdf.BatchNamespaceEdit(); edit.Add('/World/Ball', '/World/Globe'); assert layer().Apply(edit)""",
    "order": """edit = Sdf.BatchNamespaceEdit(); edit.Add('/Class', '/Class_', 0); assert layer().Apply(edit)
edit = Sdf.BatchNamespaceEdit(); edit.Add('/Class_', '/Class', 0); assert layer().Apply(edit)""",
    "sublayers": """layer().subLayerPaths.append('./sub2.usda'); layer().subLayerOffsets[1] = Sdf.LayerOffset(7)""",
}


@pytest.mark.parametrize("edit", EDITS)
def test_each_kind_of_edit_reaches_every_version(served, portable, edit):
    server = served()
    editors = [portable(server, version, user) for version, user in USERS]
    assert [one.run("result = live.backend") for one in editors] == ["portable", "fast", "portable"]
    before = all_synced(server, *editors)
    editors[0].run(EDITS[edit])
    after = all_synced(server, *editors)
    assert after != before
    # The same edit in the process of plain OpenUSD has the same result.
    editors[1].run("alone = Sdf.Layer.CreateAnonymous('.usda'); alone.ImportFromString(" + repr(ROOT) + ")\n"
                   "stage_, layer_ = stage, layer; stage = Usd.Stage.Open(alone); layer = lambda: alone\n"
                   "try:\n" + "\n".join("    " + line for line in EDITS[edit].splitlines()) +
                   "\nfinally:\n    stage, layer = stage_, layer_\nresult = alone.ExportToString()")
    assert after == editors[1].run("result = alone.ExportToString()")


def test_all_at_once(served, portable):
    """Each editor makes a part of the edits, at the same time."""
    server = served()
    editors = [portable(server, version, user) for version, user in USERS]
    all_synced(server, *editors)
    kinds = [kind for kind in EDITS if kind not in ("delete", "order")]
    for number, kind in enumerate(kinds):
        editors[number % 3].run(EDITS[kind].replace("/World/Ball", "/World/Globe") if "rename" in kinds[:number] else EDITS[kind])
        for one in editors:
            one.run("live.tick()")
    all_synced(server, *editors)


@pytest.mark.parametrize("version", OTHERS)
def test_a_rename_keeps_what_others_write_below(served, portable, version):
    """A rename is one move, and no deletion."""
    server = served()
    old, fast = portable(server, version, "old"), portable(server, BUILT_FOR, "fast")
    all_synced(server, old, fast)
    fast.run("stage.GetPrimAtPath('/World/Ball').GetAttribute('radius').Set(77)")
    old.run(EDITS["rename"])
    assert fast.flush() and old.flush()
    text = all_synced(server, old, fast)
    assert "radius = 77" in text and '"Globe"' in text and '"Ball"' not in text


@pytest.mark.parametrize("version", OTHERS)
def test_what_a_version_cannot_express_comes_back_unchanged(served, portable, version):
    unknown = ROOT.replace('    kind = "assembly"\n', '    kind = "assembly"\n    myStudio = "kept"\n') + SPLINE
    server = served(unknown)
    old, fast = portable(server, version, "old"), portable(server, BUILT_FOR, "fast")
    assert "spline" not in old.text("root.usda")
    fast.run("sample = stage.DefinePrim('/Samples').CreateAttribute('a', Sdf.ValueTypeNames.Double)\n"
             "sample.Set(1, 1); sample.Set(Sdf.AnimationBlock())\n"
             "stage.GetPrimAtPath('/Samples').CreateAttribute('edited', Sdf.ValueTypeNames.IntArray)\n"
             "builder = Vt.IntArrayEditBuilder(); builder.Append(3)\n"
             "layer().SetTimeSample('/Samples.edited', 1, Vt.IntArray([1]))\n"
             "layer().SetTimeSample('/Samples.edited', 2, builder.FinalizeAndReset())")
    old.catch_up(fast.flush())
    old.run("stage.GetPrimAtPath('/World').SetDocumentation('written here'); stage.DefinePrim('/Curves/More')")
    old.run("stage.GetPrimAtPath('/World').SetMetadata('hidden', True)")
    old.run("assert layer().ListTimeSamplesForPath('/Samples.edited') == [1]\n"
            "layer().SetTimeSample('/Samples.edited', 3, Vt.IntArray([4]))")
    fast.catch_up(old.flush())
    text = cat(server, "root.usda")
    assert plain(text) == fast.text("root.usda")
    assert fast.run("result = [type(layer().QueryTimeSample('/Samples.edited', time)).__name__ for time in (1, 2, 3)]") == [
        "IntArray", "IntArrayEdit", "IntArray"]
    assert re.search(r'double animated.spline = \{\s*1: 5', text) and "AnimationBlock" in text and 'myStudio = "kept"' in text
    assert 'doc = "written here"' in text and "hidden = true" in text and 'def "More"' in text


CUBES = "".join(f'    def Cube "Cube{number}"\n    {{\n        double size = {number}\n    }}\n' for number in range(100))
def test_a_move_that_this_openusd_refuses_is_followed(served, portable):
    """24.11 moves no prim into a variant of its parent."""
    server = served()
    old, fast = portable(server, OLDEST, "old"), portable(server, BUILT_FOR, "fast")
    fast.run("edit = Sdf.BatchNamespaceEdit(); edit.Add('/World/Ball', '/World{look=red}Moved'); assert layer().Apply(edit)")
    assert fast.flush()
    assert '"Moved"' in all_synced(server, old, fast)


BIG = ROOT + "".join(f'\ndef Scope "Group{group}"\n{{\n{CUBES}}}\n' for group in range(5))


@pytest.mark.parametrize("version", OTHERS)
def test_in_a_big_layer_a_frame_finds_what_a_stage_shows(served, portable, version):
    server = served(BIG)
    old, fast = portable(server, version, "old"), portable(server, BUILT_FOR, "fast")
    revision = fast.flush()
    read = old.run("from usdlive.portable import _content\nread = []\nadd = _content.Reader._add\n"
                   "def counted(self, spec, path, *rest, **names):\n    read.append(path)\n    add(self, spec, path, *rest, **names)\n"
                   "_content.Reader._add = counted; from usdlive.portable import live as module; module._LiveLayer.next_slice = lambda self: []\n"
                   "stage.GetPrimAtPath('/Group3/Cube7').GetAttribute('size').Set(70)\n"
                   "stage.DefinePrim('/Group1/New', 'Sphere'); stage.RemovePrim('/Group2/Cube5')\n"
                   "stage.GetPrimAtPath('/World').SetMetadata('hidden', True)\n"
                   "with stage.GetPrimAtPath('/World').GetVariantSet('look').GetVariantEditContext():\n"
                   "    stage.GetPrimAtPath('/World').GetAttribute('text').Set('in the variant')\n"
                   "live.tick(); result = read")
    assert len(read) < 30 and "/Group3/Cube7.size" in read and "/Group3/Cube8.size" not in read
    assert fast.run(f"assert live.wait(lambda: live.revision > {revision}, 20)") is None
    text = fast.text("root.usda")
    assert "double size = 70" in text and 'def Sphere "New"' in text and text.count('"Cube5"') == 4
    assert 'string text = "in the variant"' in text and "hidden = true" in text
    all_synced(server, old, fast)


@pytest.mark.parametrize("version", OTHERS)
def test_in_a_big_layer_later_frames_find_what_no_stage_shows(served, portable, version):
    server = served(BIG)
    old, fast = portable(server, version, "old"), portable(server, BUILT_FOR, "fast")
    revision = fast.flush()
    old.run("with Sdf.ChangeBlock():\n"
            "    layer().GetPrimAtPath('/World{look=blue}Box').SetInfo('documentation', 'unselected')\n"
            "    layer().GetPrimAtPath('/Group1').SetInfo('documentation', 'shown')\n"
            "assert live.wait(lambda: not live.tick(), 20)")
    fast.run(f"assert live.wait(lambda: 'unselected' in layer().ExportToString(), 20)")
    assert fast.run("result = live.revision") == revision + 2  # the shown edit came first
    all_synced(server, old, fast)


def test_what_cannot_be_shared_is_reverted_and_reported(served, portable):
    server = served()
    new = portable(server, NEWEST, "new")
    if SOAKED and not new.run("result = hasattr(Vt, 'IntArrayEditBuilder')"):
        pytest.skip(f"OpenUSD {SOAKED} has no edits of arrays")
    new.run("attribute = stage.DefinePrim('/Edited').CreateAttribute('a', Sdf.ValueTypeNames.IntArray)\n"
            "builder = Vt.IntArrayEditBuilder(); builder.Append(3)\n"
            "layer().GetAttributeAtPath('/Edited.a').SetInfo('default', builder.FinalizeAndReset())")
    new.flush()
    lost = new.run("result = [(event.code, event.message) for event in happened if type(event).__name__ == 'Lost']")
    assert [code for code, _ in lost] == ["unsupportedValue"]
    assert lost[0][1].startswith("root.usda </Edited.a> default: ")
    assert new.run("result = layer().GetAttributeAtPath('/Edited.a').HasInfo('default')") is False
    assert "int[] a" in cat(server, "root.usda")


def test_a_layer_that_an_own_edit_names_is_opened(served, portable):
    server = served()
    editor = portable(server, OLDEST, "ada")
    editor.run("made = live.create_layer('deep/other.usdc'); Sdf.PrimSpec(made, 'Other', Sdf.SpecifierDef).kind = 'prop'\n"
               "assert live.flush(); live.close_layer('deep/other.usdc'); del made")
    later = portable(server, NEWEST, "bo")
    later.run("stage.DefinePrim('/Uses').GetReferences().AddReference('./deep/other.usdc', '/Other'); assert live.flush()")
    for one in (later, editor):
        one.run("assert live.wait(lambda: (prim := stage.GetPrimAtPath('/Uses')) and Usd.ModelAPI(prim).GetKind() == 'prop', 20)")
        assert one.run("result = live.opened_layer('deep/other.usdc').permissionToEdit")


def test_a_layer_that_is_closed_has_sent_its_edits(served, portable):
    server = served()
    editor = portable(server, OLDEST, "ada")
    editor.run("kept = live.open_layer('sub.usda'); Sdf.PrimSpec(kept, 'Last', Sdf.SpecifierDef); live.close_layer('sub.usda')\n"
               "assert live.flush()")
    assert 'def "Last"' in cat(server, "sub.usda")
    assert editor.run("result = [kept.permissionToEdit, live.opened_layer('sub.usda')]") == [False, None]


def test_a_layer_that_is_closed_without_a_server_sends_its_edits_later(served, portable):
    server = served()
    editor = portable(server, OLDEST, "ada")
    editor.run("kept = live.open_layer('sub.usda')")
    server.kill()
    editor.run("assert live.wait(lambda: not live.connected, 20); Sdf.PrimSpec(kept, 'Last', Sdf.SpecifierDef); live.close_layer('sub.usda')")
    server.start()
    editor.run("assert live.wait(lambda: live.connected, 20) and live.flush(20)")
    assert 'def "Last"' in cat(server, "sub.usda")


def test_a_big_array_arrives(served, portable):
    server = served()
    old, fast, new = (portable(server, version, user) for version, user in USERS)
    old.run("stage.DefinePrim('/Big').CreateAttribute('a', Sdf.ValueTypeNames.IntArray).Set(Vt.IntArray(list(range(100_000))))")
    revision = old.flush()
    for one in (fast, new):
        one.catch_up(revision)
        one.run("assert live.wait(lambda: (value := stage.GetPrimAtPath('/Big').GetAttribute('a').Get()) is not None "
                "and list(value) == list(range(100_000)), 20)")
    fast.run("stage.GetPrimAtPath('/Big').GetAttribute('a').Set(Vt.IntArray(list(range(7, 100_007))))")
    old.catch_up(fast.flush())
    new.catch_up(fast.flush())
    for one in (old, new):
        one.run("assert live.wait(lambda: stage.GetPrimAtPath('/Big').GetAttribute('a').Get()[0] == 7, 20)")
    all_synced(server, old, fast, new)


def test_save_and_the_rest_of_the_plain_api(served, portable, project):
    server = served()
    old = portable(server, OLDEST, "old")
    old.run("stage.GetPrimAtPath('/World').SetDocumentation('saved')\nresult = str(live.save('root.usda'))")
    assert 'doc = "saved"' in (project / "root.usda").read_text()
    old.run("made = live.create_layer('made.usda'); Sdf.PrimSpec(made, 'Made', Sdf.SpecifierDef); assert live.flush()")
    assert 'def "Made"' in cat(server, "made.usda")
    assert "portable backend" in old.run("try:\n    live.player('root.usda')\nexcept usdlive.Error as error:\n    result = str(error)")
    assert old.run("result = hasattr(live, 'player')") is False
    old.run("live.close()\nresult = (live.closed, live.connected)")
    assert old.run("result = layer().permissionToEdit") is False


def test_the_backend_can_be_chosen(served, portable):
    server = served()
    assert portable(server, BUILT_FOR, "chosen", "portable").run("result = live.backend") == "portable"
    old = portable(server, OLDEST, "any")
    version = old.run("result = '.'.join(str(part) for part in Usd.GetVersion()[1:])")
    assert old.run(
        "try:\n    usdlive.connect('ws://127.0.0.1:1', backend='fast')\nexcept ImportError as error:\n    result = str(error)"
    ).startswith(f"usdlive needs usd-core==26.8 for Python 3.11; found OpenUSD {version} in ")
    assert portable(server, OLDEST, "other").run(
        "try:\n    usdlive.Live\nexcept AttributeError as error:\n    result = str(error)").startswith("usdlive has no 'Live'")


def test_a_gesture_is_shown_at_once_and_committed_as_one(served, portable):
    server = served()
    old, fast = portable(server, OLDEST, "ada"), portable(server, BUILT_FOR, "bo")
    before = old.flush()
    for one in (old, fast):
        one.run("radius = stage.GetPrimAtPath('/World/Ball').GetAttribute('radius')")
    old.run("radius.Set(4)  # before the gesture\nlive.begin_gesture()\nfor value in (5, 6, 7): radius.Set(value); live.tick()")
    fast.run("assert live.wait(lambda: radius.Get() == 7, 20)")
    old.run(f"assert live.wait(lambda: live.revision == {before + 1}, 20); live.end_gesture()")
    assert old.flush() == before + 2
    all_synced(server, old, fast)
    fast.run("live.begin_gesture(); radius.Set(8); live.wait(lambda: False, 0.2)")
    old.run("assert live.wait(lambda: radius.Get() == 8, 20); live.tick(); assert live.pending == 0")
    fast.run("live.end_gesture()")
    all_synced(server, old, fast)
    assert old.run("result = [one.author for one in live.undo().kept]") == ["bo"]
    assert old.run("with live.undo_group('Two'):\n    radius.Set(9); live.tick(); radius.Set(10)\n"
                   "result = list(live.undo_stack().undo)") == ["Edit", "Two"]
    assert old.run("assert live.undo(); result = radius.Get()") == 8
    all_synced(server, old, fast)


# The steps of undo_test.py that need no other part of the product.
UNDONE = [step for step in STEPS if "usdlive.NamespaceEditor" not in STEPS[step]]


@pytest.mark.parametrize("version", OTHERS)
def test_each_step_is_undone_and_redone_exactly(project, serve, portable, version):
    (project / "root.usda").write_text(UNDO_ROOT)
    (project / "over.usda").write_text(UNDO_OVER)
    server = serve(project)
    one, fast = portable(server, version, "ada"), portable(server, BUILT_FOR, "bo")
    one.run("texts = lambda: [layer(name).ExportToString() for name in ('root.usda', 'over.usda')]\nbefore = texts()")
    for step in UNDONE:
        one.run(f"{FIND}{STEPS[step]}\nlive.tick(); after = texts(); assert after != before")
        one.run("assert live.undo_stack().undo == ('Edit',); undone = live.undo(); assert undone and not undone.kept, undone.kept\n"
                "assert texts() == before, texts(); check()")
        one.run("assert live.redo() and texts() == after, texts(); check(); assert live.undo() and texts() == before, texts()")
    assert all_synced(server, one, fast) == plain(UNDO_ROOT)


EDIT = "stage.GetPrimAtPath('/World').SetDocumentation({!r})"
IGNORING = "layer().SetPermissionToEdit(True)  # like an editor that ignores the lock\n"
REFUSED = "assert live.flush(); result = [event.code for event in happened if type(event).__name__ == 'Lost']; happened.clear()"


@pytest.mark.parametrize("version", OTHERS)
def test_editors_of_both_backends_lock_for_each_other(served, portable, version):
    server = served()
    editors = {"old": portable(server, version, "old"), "fast": portable(server, BUILT_FOR, "fast")}
    text = all_synced(server, *editors.values())
    for holder, other in (("fast", "old"), ("old", "fast")):
        hers, his = editors[holder], editors[other]
        hers.run("live.lock('root.usda'); assert live.flush()")
        his.run("assert live.wait(lambda: not layer().permissionToEdit, 20)")
        state = his.run("state = live.layer_states()['root.usda']; result = [state.locked, state.holder, state.dirty]")
        assert state == [True, holder, True]
        assert his.run("may = live.may_edit('root.usda', '/World'); result = [may.allowed, may.why]") == [
            False, f"root.usda is locked by {holder}"]
        assert his.run("result = live.may_do('save', 'root.usda').why") == f"root.usda is locked by {holder}"
        assert "not editable" in his.run(f"try:\n    {EDIT.format('refused here')}\nexcept Exception as error:\n    result = str(error)")
        locked = all_synced(server, *editors.values())
        his.run(IGNORING + EDIT.format("refused there"))
        assert his.run(REFUSED) == ["locked"] and his.text("root.usda") == locked
        hers.run(EDIT.format(f"by {holder}"))
        his.catch_up(hers.flush())
        assert f'doc = "by {holder}"' in his.text("root.usda")
        # Only its holder ends it.
        his.run("live.unlock('root.usda')")
        assert his.run(REFUSED) == ["locked"]
        hers.run("live.unlock('root.usda'); assert live.flush()")
        his.run("assert live.wait(lambda: live.may_edit('root.usda'), 20) and layer().permissionToEdit")
        his.run(EDIT.format(f"by {other}"))
        assert his.run(REFUSED) == []
        hers.catch_up(his.flush())
    assert text != all_synced(server, *editors.values())


@pytest.mark.parametrize("version", OTHERS)
def test_a_locked_spec_is_given_back(served, portable, version):
    """LK5. Kit's API locks specs in the root layer of a stage."""
    server = served()
    old, fast = portable(server, version, "old"), portable(server, BUILT_FOR, "fast")
    fast.run("layer().customLayerData = {**layer().customLayerData, 'omni_layer': {'specs_locking': {'/World/Ball': 'fast'}}}")
    before = fast.flush()
    old.catch_up(before)
    text = old.text("root.usda")
    old.run("stage.GetPrimAtPath('/World/Ball').SetMetadata('hidden', True)")
    assert old.run(REFUSED) == ["locked"] and old.text("root.usda") == text
    old.run("stage.GetPrimAtPath('/World/Box').SetMetadata('hidden', True)")
    assert old.run(REFUSED) == [] and old.flush() == before + 1


@pytest.mark.parametrize("version", OTHERS)
def test_a_mute_for_everybody_reaches_the_stages_of_every_version(served, portable, version):
    server = served()
    editors = [portable(server, version, "old"), portable(server, BUILT_FOR, "fast")]
    composed = "stage.GetPrimAtPath('/World').HasAttribute('fromBelow')"
    for one, other in (editors, editors[::-1]):
        one.run("live.mute('root.usda', 'sub.usda'); assert live.flush()")
        for each in (one, other):
            each.run(f"assert live.wait(lambda: not {composed}, 20) and len(stage.GetMutedLayers()) == 1")
        other.run("live.unmute('root.usda', 'sub.usda'); assert live.flush()")
        for each in (one, other):
            each.run(f"assert live.wait(lambda: {composed}, 20) and live.globally_muted('root.usda') == []")
    all_synced(server, *editors)


@pytest.mark.parametrize("version", OTHERS)
def test_checkpoints_and_the_history_are_those_of_the_fast_backend(served, portable, version):
    server = served()
    old, fast = portable(server, version, "old"), portable(server, BUILT_FOR, "fast")
    with_label = f"with live.undo_group('Describe'): {EDIT.format('one')}\n"
    old.run(with_label + "made = live.create_checkpoint('lunch')")
    old.run(EDITS["rename"] + "\nassert live.flush()")
    fast.catch_up(old.flush())
    fast.run("stage.GetPrimAtPath('/World/Globe').GetAttribute('radius').Set(5)")
    old.catch_up(fast.flush())
    asked = ["[vars(one) for one in live.checkpoints()]", "[repr(one) for one in live.log()]", "[one.user for one in live.log(by='fast')]",
             "[one.label for one in live.log(label='describe', limit=1)]",
             "[repr(one) for one in live.log(layer='root.usda', path='/World/Globe')]",
             "[repr(one) for one in live.blame('root.usda', '/World', below=True)]"]
    answers = [old.run(f"result = {one}") for one in asked]
    assert answers == [fast.run(f"result = {one}") for one in asked]
    assert [one["name"] for one in answers[0]] == ["lunch"] and answers[2:4] == [["fast"], ["Describe"]]
    assert "'/World/Ball'" in answers[4][-1] and len(answers[5]) > 20
    shown = ("past = {open}\nresult = {{str(prim.GetPath()): [(one.GetName(), str(one.Get())) for one in prim.GetAttributes()]"
             " for prim in past.TraverseAll()}}")
    for at in ("'lunch'", "1", "live.revision"):
        before = shown.format(open=f"live.open_stage('root.usda', at={at})")
        assert old.run(before) == fast.run(before) and ("/World/Ball" in old.run(before)) == (at != "live.revision")
    assert old.run("import asyncio\n" + shown.format(open="asyncio.run(live.open_stage_async('root.usda'))")) == old.run(before)
    for call, code in (("live.create_checkpoint('lunch')", "checkpointExists"), ("live.open_stage('root.usda', at='none')", "invalidArgument"), ("live.blame('root.usda', '/None')", "specNotFound"),
                       ("list(live.log(layer='none.usda'))", "layerNotFound"), ("live.lock('none.usda')", "layerNotOpen"),
                       ("live.may_edit('root.usda', '/World', 'colour')", "invalidArgument")):
        for one in (old, fast):
            assert one.run(f"try:\n    {call}\nexcept usdlive.Error as error:\n    result = error.code") == code, call


@pytest.mark.parametrize("version", OTHERS)
def test_live_sessions_are_made_and_merged(served, portable, version):
    server = served()
    main = portable(server, version, "old")
    made = main.run("sessions = usdlive.sessions(url, user='old'); made = sessions.create('dusk'); result = vars(made)")
    assert (made["name"], made["creator"], made["ended"]) == ("dusk", "old", False)
    main.run(f"with usdlive.connect(made.address, user='new') as idea:\n    idea.open_layer('root.usda').{RADIUS} = 7\n    assert idea.flush()")
    main.run(f"layer().{RADIUS} = 8; assert live.flush()")
    [found] = main.run("result = [vars(one) for one in sessions.merge('dusk', dry_run=True).conflicts]")
    assert (found["path"], found["main_user"], found["session_user"]) == ("/World/Ball.radius", "old", "new")
    merged = main.run("result = sessions.merge('dusk', take=lambda conflict: 'session').revision")
    main.catch_up(merged)
    assert main.run(f"result = layer().{RADIUS}") == 7
    assert main.run("result = [one.ended for one in usdlive.sessions(url).list()]") == [True]


@pytest.mark.parametrize("seed", range(int(os.environ.get("USDLIVE_PORTABLE_SEEDS", "3"))))
def test_random_edits_end_the_same_everywhere(served, portable, seed):
    server = served("#usda 1.0\n")
    editors = [portable(server, version, user) for version, user in USERS]
    for number, one in enumerate(editors):
        one.run(f"import portable_edits, random\nr = random.Random({10 * seed + number})\n"
                "edits = lambda count: [portable_edits.make(r, layer()) for _ in range(count)]")
    for _ in range(12):
        for one in editors:
            one.run("edits(r.randrange(6)); live.tick(); check()")
    all_synced(server, *editors, may_lose=True)  # edits below what another has deleted
